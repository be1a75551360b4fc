"""The driver: which tasks are left, who is tried again, when a point has replicates enough, and when all is over.

    drive(folder, engine, part=ALL, watch=None, stop=...) -> Ended

Nothing that is decided here depends on the engine, on the number of workers, or on the order in which tasks end.
"""

from __future__ import annotations

import os
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, final

from wsnsim.analysis.stopping import ReplicateCounts
from wsnsim.base.errors import ResultError
from wsnsim.base.version import __version__
from wsnsim.campaign.accounts import ALL, Ended, Part, Progress
from wsnsim.campaign.engines import Ending, Engine, EngineError, Vanished
from wsnsim.campaign.task import Outcome, Task, timed_out
from wsnsim.recording.folder import Folder, Manifest, runs_of

GRACE: Final = 10.0
"""s: what a task that runs is given to end, once the campaign is told to stop."""
TICK: Final = 0.25
"""s: how long the driver waits for workers before it looks up."""
MOST_OF_A_MARK: Final = 4000
MOST_LOST: Final = 20
"""Times that a task may be lost with its worker before it began: others are at fault, but there is an end to it."""
OFTEN: Final = 3
"""Times after which it is run alone."""


def drive(
    folder: Folder,
    engine: Engine,
    part: Part = ALL,
    watch: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Ended:
    """Run what is missing of a campaign. Its manifest and scenarios are on disk; so are its results as they come."""
    try:
        driver = _Driver(folder, folder.manifest(), engine, part, watch)
        driver.run(stop)
    finally:
        engine.close()
        folder.clear()
    return driver.ended()


@final
@dataclass
class _Driver:
    """One session's books."""

    folder: Folder
    manifest: Manifest
    engine: Engine
    part: Part
    watch: Callable[[Progress], None] | None
    pending: deque[Task] = field(default_factory=deque)
    suspects: deque[Task] = field(default_factory=deque)
    running: dict[str, Task] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    left: dict[str, int] = field(default_factory=dict)
    lost: Counter[str] = field(default_factory=Counter)
    alone: str = ""
    stopped: str = ""
    done: int = 0
    found: int = 0

    def __post_init__(self) -> None:
        self.began = time.monotonic()
        self.session = f"{socket.gethostname().split('.')[0]}-{os.getpid()}-{time.time_ns():x}"
        self.rule = ReplicateCounts(self.folder, self.manifest)
        self.targets = {point.id: self.rule.first(point) for point in self.manifest.points}
        self.places = {point.id: i for i, point in enumerate(self.manifest.points)}
        self.failed_before = set(self.folder.failures())

    def run(self, stop: Callable[[], bool]) -> None:
        """Until nothing is left, or somebody says stop."""
        self.folder.clear()
        for point in self.targets:
            self.plan(point, 0)
        self.pending = deque(sorted(self.pending, key=lambda task: task.first))  # so that what there is can be compared
        try:
            while not self.stopped and (self.pending or self.suspects or self.running):
                if stop():
                    self.stopped = "interrupted"
                    break
                self.fill()
                self.settle(self.engine.ended(TICK))
                self.tell()
            self.wind_up()
        except EngineError as error:
            self.stopped = str(error)
        self.tell()

    def plan(self, point: str, first: int) -> None:
        """Tasks for the replicates of a point from `first` to its target that are not on disk; then ask the rule."""
        wanted = [number for number in range(first, self.targets[point]) if self.is_ours(point, number)]
        done = self.folder.done(point)
        missing = [number for number in wanted if number not in done]
        self.found += len(wanted) - len(missing)
        self.queue(point, missing)
        if not missing:
            self.grow(point)

    def queue(self, point: str, missing: Sequence[int]) -> None:
        """Tasks for these replicates, in order."""
        self.left[point] = self.left.get(point, 0) + len(missing)
        for begin, end in runs_of(missing, self.manifest.block):
            self.pending.append(self.task(point, begin, end))

    def is_ours(self, point: str, replicate: int) -> bool:
        """Whether this part of the campaign has the replicate. With a stopping rule, a point is not shared."""
        block = 0 if self.manifest.until else replicate // self.manifest.block
        return self.part.has(self.places[point], block)

    def task(self, point: str, first: int, last: int) -> Task:
        """A task of this session."""
        where = str(self.folder.path.resolve())
        return Task(where, point, first, last, self.session, __version__, self.manifest.timeout)

    def fill(self) -> None:
        """Give the engine what it can take; what killed a worker is run when nothing else is, and alone."""
        while self.pending and not self.alone and len(self.running) < self.engine.window:
            self.submit(self.pending.popleft())
        if self.suspects and not self.pending and not self.running:
            task = self.suspects.popleft()
            self.alone = task.name
            self.submit(task)

    def submit(self, task: Task) -> None:
        """Under way."""
        self.running[task.name] = task
        self.engine.submit(task)

    def settle(self, endings: Iterable[Ending]) -> None:
        """What follows from the ends of tasks."""
        vanished = []
        for task, outcome in endings:
            del self.running[task.name]
            if isinstance(outcome, Vanished):
                vanished.append(task)
            else:
                was_alone, self.alone = self.alone == task.name, "" if self.alone == task.name else self.alone
                self.judge(task, outcome, was_alone)
        if vanished:
            self.look_into(vanished)

    def judge(self, task: Task, outcome: Outcome, was_alone: bool) -> None:
        """A worker said how a task ended."""
        if outcome.status == "withdrawn":
            return
        if outcome.status in ("storage", "version"):
            self.stopped = outcome.words
        elif outcome.status == "suspect":
            self.folder.remove_marks(self.session, task.name)
            if was_alone:
                self.give_up(task, outcome.words, alone=True)
            else:
                self.suspects.append(task)
        elif outcome.status == "failed":
            self.give_up(task, outcome.words)
        else:
            self.finish(task, outcome)

    def finish(self, task: Task, outcome: Outcome) -> None:
        """The task's file is there."""
        self.done += task.replicates
        for one in task.singly():
            if one.name in self.failed_before:
                self.folder.forget_failure(one.name)
        self.left[task.point] -= task.replicates
        if not self.left[task.point]:
            self.grow(task.point)

    def grow(self, point: str) -> None:
        """Ask the rule whether the point, of which nothing is left to do, has replicates enough.

        A file that it cannot read is put aside, and its replicates are run again.
        """
        before = self.targets[point]
        try:
            if self.manifest.until and self.is_ours(point, 0):
                self.targets[point] = self.rule.next(point, before)
        except ResultError as error:
            if self.folder.set_aside(point):
                missing = self.folder.missing(point, before)
                self.found -= len(missing)
                self.queue(point, missing)
                if not missing:  # others hold what it held
                    self.grow(point)
            else:
                self.failed[point] = str(error)
        if self.targets[point] > before:
            self.plan(point, before)

    def look_into(self, tasks: Iterable[Task]) -> None:
        """Workers died: which tasks were they running, and does what one of them left explain why?"""
        left = [(task, self.folder.left_by(self.session, task.name)) for task in tasks]
        is_known = any("".join(marks) for _, marks in left)
        for task, marks in left:
            self.folder.remove_marks(self.session, task.name)
            was_alone, self.alone = self.alone == task.name, "" if self.alone == task.name else self.alone
            words = "\n".join(mark[:MOST_OF_A_MARK] for mark in marks)
            if timed_out(words):
                self.give_up(task, f"took more than {task.timeout:g} s", words)
            elif not marks or (is_known and not words):  # it had not begun, or died with its neighbour
                self.try_again(task, was_alone)
            elif not was_alone:
                self.suspects.append(task)
            else:
                self.give_up(task, f"killed its worker twice ({_cause(words)})", words, alone=True)

    def try_again(self, task: Task, alone: bool) -> None:
        """A task that is not to blame is next, unless that has been said of it too often."""
        self.lost[task.name] += 1
        if self.lost[task.name] >= MOST_LOST and alone:
            self.give_up(task, f"was lost with its worker {MOST_LOST} times", alone=alone)
        elif alone or self.lost[task.name] >= OFTEN:
            self.suspects.append(task)
        else:
            self.pending.appendleft(task)

    def give_up(self, task: Task, words: str, more: str = "", alone: bool = False) -> None:
        """Of a task of several replicates, each is tried by itself; one that fails by itself has failed."""
        if task.replicates > 1:
            done = self.folder.done(task.point)
            there = [one for one in task.singly() if one.first in done]
            (self.suspects if alone else self.pending).extend(one for one in task.singly() if one.first not in done)
            self.done, self.left[task.point] = self.done + len(there), self.left[task.point] - len(there)
            return
        self.failed[task.name] = words
        settings = self.manifest.point(task.point).settings
        said = ", ".join(f"{key} = {value}" for key, value in settings.items())
        self.folder.write_failure(task.name, "\n".join([words, f"replicate {task.first}, {said}", more]).strip() + "\n")

    def wind_up(self) -> None:
        """Told to stop: nothing new is begun, and what runs has ten seconds."""
        if self.stopped:
            for task in self.engine.withdraw():
                self.running.pop(task.name, None)
        until = time.monotonic() + GRACE
        while self.running and time.monotonic() < until:
            self.settle(self.engine.ended(TICK))
            self.tell()

    def tell(self) -> None:
        """Say how far it is."""
        if self.watch is None:
            return
        wall, left = time.monotonic() - self.began, sum(self.left.values())
        total = self.found + self.done + left
        rest = wall / self.done * (left - len(self.failed)) if self.done else None
        self.watch(Progress(self.found + self.done, len(self.failed), total, wall, rest))

    def ended(self) -> Ended:
        """The books, compared with the disk."""
        missing: dict[str, list[int]] = {}
        for point, target in self.targets.items():
            numbers = [n for n in self.folder.missing(point, target) if self.is_ours(point, n)]
            if numbers:
                missing[point] = numbers
        seconds = time.monotonic() - self.began
        return Ended(self.done, self.found, self.failed, missing, self.stopped, seconds)


def _cause(mark: str) -> str:
    """Why a worker died, from what it left: the first line, or what an empty mark means."""
    lines = [line for line in mark.splitlines() if line.strip()]
    return lines[0].removeprefix("Fatal Python error: ") if lines else "killed from outside, as where memory runs out"
