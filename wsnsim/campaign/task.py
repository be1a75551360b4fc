"""A task, and what a worker does with it: run a block of replicates of one point into a file of its own.

    perform(task) -> Outcome            in the worker's process; also the whole of what crosses to it and back

Whoever runs a task, where and how often, leaves one file of the same rows. A task that kills its worker leaves a mark
in the campaign's folder; one that takes too long ends its worker itself, and says in the mark where it was.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import json
import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TextIO

from wsnsim.base.errors import StorageError, WsnsimError
from wsnsim.base.version import __version__
from wsnsim.recording.folder import Folder
from wsnsim.recording.layout import cannot_write

Status = Literal["done", "there", "failed", "suspect", "storage", "version", "withdrawn"]
MOST_WORDS: Final = 600
TIMEOUT_MARK: Final = "Timeout ("
"""How faulthandler begins what it writes when the time is up."""
START: Final = 60.0
"""s: what a worker that has just started may take to import what the scenario needs, beside its time for replicates."""
ROOM: Final = 4_000_000
"""bytes: what must be free before a task begins; the file of a block takes some 50 kB."""
KILLS: Final = 2
"""Workers that a task may kill before nobody takes it up again."""


@dataclass(frozen=True, slots=True)
class Task:
    """Replicates `first` to `last` of one point of the campaign in `folder`.

    `session` names the driver; `version` is its wsnsim; a replicate that takes more than `timeout` seconds is given up.
    """

    folder: str
    point: str
    first: int
    last: int
    session: str
    version: str
    timeout: float | None = None

    @property
    def name(self) -> str:
        """Point and replicates: the name of its file, and of its failure."""
        return f"{self.point}.r{self.first:05d}-{self.last:05d}"

    @property
    def replicates(self) -> int:
        """How many replicates it has."""
        return self.last - self.first + 1

    def singly(self) -> list[Task]:
        """A task for each replicate."""
        numbers = range(self.first, self.last + 1)
        return [Task(self.folder, self.point, n, n, self.session, self.version, self.timeout) for n in numbers]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a task ended, and what it took: seconds of wall clock, bytes of its file."""

    status: Status
    words: str = ""
    seconds: float = 0.0
    size: int = 0


def perform(task: Task) -> Outcome:
    """Run a task, unless its file is there. Never raises: what went wrong is in the outcome, a plug-in's exit, too.

    Statuses: done; there (the file was); failed (the simulation); suspect (workers that had it have died); storage (the
    file cannot be written: no other could be); version (this worker has another wsnsim than the driver); withdrawn
    (the campaign is to stop).
    """
    began = time.monotonic()
    folder = Folder(task.folder)
    path = folder.batch(task.point, task.first, task.last)
    try:
        if path.is_file():
            return Outcome("there", size=path.stat().st_size)
        if task.version != __version__:
            return Outcome("version", f"the worker has wsnsim {__version__}, the campaign is run by {task.version}")
        if outcome := _given_up(folder, task):
            return outcome
        _demand_room(path)
        with _marked(folder, task) as mark:
            _run(folder, task, path, mark)
        return Outcome("done", seconds=time.monotonic() - began, size=path.stat().st_size)
    except StorageError as error:
        return Outcome("storage", words_of(error))
    except BaseException as error:
        return Outcome("failed", words_of(error), time.monotonic() - began)


def words_of(error: BaseException) -> str:
    """What went wrong, in less than a kilobyte that can be written down."""
    try:
        said = str(error) if isinstance(error, WsnsimError) else f"{type(error).__name__}: {error}"
    except Exception:
        said = f"{type(error).__name__}, which cannot say what it is about"
    said = said.encode("utf-8", "backslashreplace").decode("utf-8")
    return said if len(said) <= MOST_WORDS else f"{said[: MOST_WORDS - 2]} …"


def timed_out(mark: str) -> bool:
    """Whether a mark says that the time was up."""
    return TIMEOUT_MARK in mark


def _run(folder: Folder, task: Task, path: Path, mark: TextIO) -> None:
    _arm(task, mark, START)
    from wsnsim.experiment import Progress, run

    scenario = _scenario(folder.scenario(task.point))
    reached = [-1]

    def watch(progress: Progress) -> None:
        if progress.replicate != reached[0]:
            reached[0] = progress.replicate
            _arm(task, mark)

    _arm(task, mark)
    run(
        scenario,
        replicates=range(task.first, task.last + 1),
        out=path,
        command_line="a campaign's worker",
        progress=watch if task.timeout else None,
    )


def _demand_room(path: Path) -> None:
    """Raise StorageError where the disk is all but full: HDF5 may crash when it runs out of space."""
    with contextlib.suppress(OSError):
        if shutil.disk_usage(path.parent).free < ROOM:
            raise StorageError(f"{path}: cannot be written: less than {ROOM / 1e6:.0f} MB are left on the disk")


def _arm(task: Task, mark: TextIO, more: float = 0.0) -> None:
    """From now on the process ends once the time is up, even where it is in compiled code."""
    if task.timeout:
        faulthandler.dump_traceback_later(task.timeout + more, exit=True, file=mark)


@contextlib.contextmanager
def _marked(folder: Folder, task: Task) -> Iterator[TextIO]:
    """A mark while the task runs. If the process dies, it stays, with the place in the code if that can be said."""
    place = folder.mark(task.session, task.name)
    before = faulthandler.is_enabled()
    try:
        place.parent.mkdir(exist_ok=True)
        mark = place.open("w", encoding="utf-8")
    except OSError as error:
        raise cannot_write(place, error) from error
    with mark:
        faulthandler.enable(mark)
        try:
            yield mark
        finally:
            faulthandler.cancel_dump_traceback_later()
            faulthandler.disable()
            if before:
                with contextlib.suppress(OSError, RuntimeError):  # where stderr is no file, as in a notebook
                    faulthandler.enable()
            place.unlink(missing_ok=True)


def _given_up(folder: Folder, task: Task) -> Outcome | None:
    """Why this is not the moment to take the task up again: its marks of this session; None if there is no reason."""
    marks = folder.left_by(task.session, task.name)
    if any(timed_out(mark) for mark in marks):
        return Outcome("failed", f"took more than {task.timeout:g} s")
    return Outcome("suspect", f"{len(marks)} workers died of it") if len(marks) >= KILLS else None


@functools.lru_cache(maxsize=8)
def _scenario(resolved: str) -> Any:
    """A point's scenario, checked once a process, and its parts imported."""
    import wsnsim.scenario as scenario

    loaded = scenario.load(json.loads(resolved))
    scenario.build(loaded)
    return loaded


def start_worker(began: Any = None) -> None:
    """What a worker's process does first: leave signals to the driver, end when it does, and say that it has begun.

    What a tracker prints goes to stderr: stdout is the driver's answer.
    """
    import multiprocessing
    import signal
    import threading

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.dup2(2, 1)
    if began is not None:
        began.value = 1
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)
