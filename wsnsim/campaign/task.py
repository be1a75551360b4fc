"""A task: a block of replicates of one point, which a worker runs into one result file.

The file does not depend on the worker, nor on how often the task is run. A worker keeps a marker file in the campaign's
folder while it runs a task. If the task kills the worker, the marker stays. If the task takes too long, it ends the
worker's process, and the marker holds the traceback.

Worker processes end with the process that started them, however that ended. Linux kills them: a thread that waits for
the parent cannot run while compiled code holds the interpreter's lock. On other systems there is only the thread.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import json
import multiprocessing
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, TextIO

from wsnsim.base.errors import StorageError, UsageError, WsnsimError
from wsnsim.base.plugin_code import plugin_fault
from wsnsim.base.version import __version__
from wsnsim.recording.atomic_files import cannot_write, host
from wsnsim.recording.folder import MOST_NUMBERED, Folder
from wsnsim.scenario.registry import ACCESS_OF_FILES, PluginAccess, search

PR_SET_PDEATHSIG: Final = 1
"""The option of prctl(2) that asks for a signal when the parent ends."""


def end_with_parent() -> None:
    """Let this process end when its parent has ended, or at once if it has ended already.

    On Linux the parent is the thread that started this process. It must live as long as the process is needed.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        _ask_for_signal()
        if os.getppid() != parent.pid:  # it ended before the signal was asked for
            os._exit(1)
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _ask_for_signal() -> None:
    """Ask Linux to kill this process when its parent ends. Where that is forbidden, the thread remains."""
    import ctypes

    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL))


def _exit_after(parent: Any) -> None:
    parent.join()
    os._exit(1)


TaskStatus = Literal["done", "exists", "failed", "impossible", "suspect", "storage", "version", "cancelled"]
OTHER_RUNS: Final = (MOST_NUMBERED + 1, MOST_NUMBERED + 2)
"""Numbers of runs, which no campaign has, that are begun to see whether a failure depends on random numbers."""
MAX_MESSAGE: Final = 600
"""Characters of an error message that are kept."""
COMMAND_LINE: Final = "a campaign's worker"
"""The command that the provenance of a task's file names."""
TIMEOUT_MARK: Final = "Timeout ("
"""How the text that faulthandler writes at a timeout begins."""
IMPORT_TIME: Final = 60.0
"""Seconds that a new worker may take for its imports, in addition to the timeout of a replicate."""
LEAST_TIMEOUT: Final = 10.0
"""Seconds: with a shorter timeout of a replicate, replicates are made one at a time."""
MIN_FREE: Final = 4_000_000
"""Bytes that must be free on the disk before a task starts; the file of a block takes about 50 kB."""
MAX_KILLS: Final = 2
"""Workers that a task may kill before it counts as failed."""


@dataclass(frozen=True, slots=True)
class Task:
    """Replicates `first` to `last` of one point of the campaign in `folder`.

    Attributes:
        session: name of the session that runs the campaign.
        version: version of wsnsim in that session.
        timeout: seconds after which a replicate fails, None for no limit.
        batch: whether standalone runs may be made many at once.
        code: digest of the code that is to make the runs, '' if it is unknown.
        access: which plug-ins the scenario may name, and where their modules are looked for.
    """

    folder: str
    point: str
    first: int
    last: int
    session: str
    version: str
    timeout: float | None = None
    batch: bool = True
    code: str = ""
    access: PluginAccess = ACCESS_OF_FILES

    @property
    def name(self) -> str:
        """Point and replicates, such as `3f2a.r00000-00004`: names its marker and its failure report."""
        return f"{self.point}.r{self.first:05d}-{self.last:05d}"

    @property
    def replicates(self) -> int:
        """Number of replicates."""
        return self.last - self.first + 1

    def singly(self) -> list[Task]:
        """One task per replicate."""
        return [replace(self, first=number, last=number) for number in range(self.first, self.last + 1)]


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """How a task ended: status, reason of a failure, duration (s), size of its file (bytes), and compilation (s).

    The statuses:
        done: the file was written.
        exists: the file was there before.
        failed: the simulation failed.
        impossible: it failed, and so do runs with other random numbers, in their first step.
        suspect: workers died while they ran this task.
        storage: the file cannot be written, and no other file could be.
        version: the worker's version of wsnsim, or its code, differs.
        cancelled: the campaign stops.
    """

    status: TaskStatus
    reason: str = ""
    seconds: float = 0.0
    size: int = 0
    compiling: float = 0.0


class OtherCodeError(UsageError):
    """A worker's code differs from that of the campaign."""


def perform(task: Task) -> TaskOutcome:
    """Run a task unless its file exists. It never raises: every error, a plug-in's exit included, is an outcome."""
    began = time.monotonic()
    folder = Folder(task.folder)
    path = folder.batch(task.point, task.first, task.last)
    try:
        if path.is_file():
            return TaskOutcome("exists", size=path.stat().st_size)
        if task.version != __version__:
            return TaskOutcome(
                "version", f"the worker has wsnsim {__version__}, but the campaign runs with {task.version}"
            )
        if outcome := _blamed(folder, task):
            return outcome
        _check_free_space(path)
        with _marker_kept(folder, task) as marker:
            compiling = _run(folder, task, path, marker)
        return TaskOutcome("done", "", time.monotonic() - began, path.stat().st_size, compiling)
    except StorageError as error:
        return TaskOutcome("storage", describe_error(error))
    except OtherCodeError as error:
        return TaskOutcome("version", describe_error(error))
    except BaseException as error:
        status: TaskStatus = "impossible" if _is_impossible(folder, task) else "failed"
        return TaskOutcome(status, describe_error(error), time.monotonic() - began)


def describe_error(error: BaseException) -> str:
    """The message of an error as encodable text, shorter than a kilobyte."""
    try:
        text = str(error) if isinstance(error, WsnsimError) else ""
        text = text or plugin_fault(error) or f"{type(error).__name__}: {error}"
    except Exception:
        text = f"{type(error).__name__} (its message cannot be read)"
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return text if len(text) <= MAX_MESSAGE else f"{text[: MAX_MESSAGE - 2]} …"


def is_timeout(marker: str) -> bool:
    """Whether the text of a marker reports a timeout."""
    return TIMEOUT_MARK in marker


def session_name() -> str:
    """A name for a session that this process begins, unlike that of any other."""
    return f"{host()}-{os.getpid()}-{time.time_ns():x}"


def cause_of_death(marker: str) -> str:
    """Why a worker died: the first line of its marker, or what an empty marker means."""
    lines = [line for line in marker.splitlines() if line.strip()]
    return lines[0].removeprefix("Fatal Python error: ") if lines else "killed from outside, perhaps out of memory"


def _run(folder: Folder, task: Task, path: Path, marker: TextIO) -> float:
    """Make the runs of a task. Return for how long (s) kernels were compiled."""
    _set_timeout(task, marker, IMPORT_TIME)
    import wsnsim.experiment as experiment
    from wsnsim.models.compilation import compilation_wall

    before = compilation_wall()

    scenario = _scenario(folder.scenario(task.point), task.access)
    _demand_code(task.folder, task.code)
    if (folder.path / task.point / "visits.json").is_file():
        from wsnsim.lifetimes.stored_visits import simulate_visit

        simulate_visit(scenario, folder.path / task.point, task.first, path)
        return compilation_wall() - before
    current = -1

    def restart_timeout(progress: experiment.Progress) -> None:
        nonlocal current
        if progress.replicate != current:
            current = progress.replicate
            _set_timeout(task, marker)

    _set_timeout(task, marker)
    experiment.run(
        scenario,
        replicates=range(task.first, task.last + 1),
        out=path,
        command_line=COMMAND_LINE,
        progress=restart_timeout if task.timeout else None,
        batch=task.batch and not 0.0 < (task.timeout or 0.0) < LEAST_TIMEOUT,
        code=task.code,
    )
    return compilation_wall() - before


class _FirstStepEnded(BaseException):  # an Exception would be reported as a failed run
    """Ends a run whose first step has ended."""


def _is_impossible(folder: Folder, task: Task) -> bool:
    """Whether other runs of a failed task's point fail as well, in their first step: then all are given up."""

    def stop(time: float) -> None:
        if time > 0.0:
            raise _FirstStepEnded

    with contextlib.suppress(BaseException), _marker_kept(folder, task) as marker:
        import wsnsim.experiment as experiment

        for number in OTHER_RUNS:
            _set_timeout(task, marker, IMPORT_TIME)
            with contextlib.suppress(Exception):
                scenario = _scenario(folder.scenario(task.point), task.access)
                experiment.simulate_run(scenario, number, progress=stop)
                return False
        return True
    return False


def _check_free_space(path: Path) -> None:
    """Raise StorageError if the disk is nearly full: HDF5 may crash when it runs out of space."""
    with contextlib.suppress(OSError):
        if shutil.disk_usage(path.parent).free < MIN_FREE:
            raise StorageError(f"{path}: cannot be written: less than {MIN_FREE / 1e6:.0f} MB are free on the disk")


def _set_timeout(task: Task, marker: TextIO, extra: float = 0.0) -> None:
    """End the process after the timeout, counted from now, even if it is in compiled code."""
    if task.timeout:
        faulthandler.dump_traceback_later(task.timeout + extra, exit=True, file=marker)


@contextlib.contextmanager
def _marker_kept(folder: Folder, task: Task) -> Iterator[TextIO]:
    """Keep a marker file while the task runs. If the process dies, the file stays, with a traceback if there is one."""
    path = folder.marker(task.session, task.name)
    before = faulthandler.is_enabled()
    try:
        path.parent.mkdir(exist_ok=True)
        marker = path.open("w", encoding="utf-8")
    except OSError as error:
        raise cannot_write(path, error) from error
    with marker:
        faulthandler.enable(marker)
        try:
            yield marker
        finally:
            faulthandler.cancel_dump_traceback_later()
            faulthandler.disable()
            if before:
                with contextlib.suppress(OSError, RuntimeError):  # stderr may be no file, as in a notebook
                    faulthandler.enable()
            with contextlib.suppress(OSError):  # the result is on disk
                path.unlink(missing_ok=True)


def _blamed(folder: Folder, task: Task) -> TaskOutcome | None:
    """The outcome of a task that this session's markers blame for a timeout or for dead workers, otherwise None."""
    markers = folder.marker_texts(task.session, task.name)
    if any(is_timeout(marker) for marker in markers):
        return TaskOutcome("failed", f"took more than {task.timeout:g} s")
    return TaskOutcome("suspect", f"killed {len(markers)} workers") if len(markers) >= MAX_KILLS else None


@functools.lru_cache(maxsize=8)
def _scenario(resolved: str, access: PluginAccess) -> Any:
    """A point's scenario, checked once per process, with its components imported."""
    import wsnsim.scenario as scenario

    search(access.folders)
    loaded = scenario.load(json.loads(resolved), plugins=access.plugins)
    scenario.build(loaded)
    return loaded


@functools.lru_cache(maxsize=8)
def _demand_code(folder: str, code: str) -> None:
    """Raise OtherCodeError if this process has other code than the campaign. One that has the same is checked once."""
    if not code:
        return
    from wsnsim.analysis.campaign_info import shortened
    from wsnsim.campaign.code_changes import changed_files, code_id, code_of
    from wsnsim.recording.provenance import PACKAGE

    expected = Folder(folder).manifest().code
    found = code_of(set(expected) - {PACKAGE}, expected)
    if code_id(found) != code:
        files = shortened(changed_files(expected, found)) or "the campaign was prepared again with other code"
        raise OtherCodeError(f"the code of a worker differs from that with which the campaign was started: {files}")


def start_worker(started: Any = None) -> None:
    """Prepare a worker's process: ignore signals, end with the parent process, and set the flag `started`.

    Output of a plug-in goes to stderr, because stdout carries the answer of the command.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.dup2(2, 1)
    if started is not None:
        started.value = 1
    end_with_parent()
