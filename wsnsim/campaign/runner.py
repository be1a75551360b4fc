"""The runner of a campaign: which tasks are missing, what is retried, and when a point has enough replicates.

No decision depends on the engine, on the number of workers, or on the order in which tasks finish.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, final

from wsnsim.analysis.campaign_info import ReplicateCounts
from wsnsim.base.errors import ResultError
from wsnsim.base.version import __version__
from wsnsim.campaign import engines
from wsnsim.campaign.code_changes import code_id
from wsnsim.campaign.task import Task, TaskOutcome, cause_of_death, is_timeout, session_name
from wsnsim.recording.folder import Folder, Manifest, consecutive
from wsnsim.scenario.registry import ACCESS_OF_FILES, PluginAccess

GRACE: Final = 10.0
"""Seconds that running tasks get to finish after the campaign is stopped."""
POLL: Final = 0.25
"""Seconds to wait for workers before checking for a stop and reporting progress."""
MAX_LOSSES: Final = 20
"""A task fails that was lost with its worker this often without being the cause."""
MAX_MARKER: Final = 8000
"""Characters of markers that are kept in the report of a failure."""
LOSSES_BEFORE_ISOLATION: Final = 3
"""A task that was lost this often is run alone."""


def run_campaign(
    folder: Folder,
    engine: engines.Engine,
    shard: engines.Shard = engines.WHOLE,
    on_progress: Callable[[engines.CampaignProgress], None] | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    batch: bool = True,
    access: PluginAccess = ACCESS_OF_FILES,
) -> engines.CampaignOutcome:
    """Run the missing tasks of a campaign whose manifest and scenarios are on disk, and close the engine.

    Args:
        folder: the campaign's folder.
        engine: what runs the tasks.
        shard: the part of the campaign to run.
        on_progress: called with the progress several times a second.
        should_stop: asked several times a second whether to stop.
        batch: whether standalone runs may be made many at once.
        access: which plug-ins the scenarios may name; by default those that installed packages offer.
    """
    try:
        runner = _CampaignRunner(
            folder, folder.manifest(), engine, shard, on_progress or (lambda progress: None), batch, access
        )
        runner.run(should_stop)
    finally:
        engine.close()
        folder.remove_leftovers()
    return runner.outcome()


@final
@dataclass
class _CampaignRunner:
    """One session of a campaign.

    Attributes:
        pending: tasks to submit.
        suspects: tasks whose worker died, to be run alone.
        running: submitted tasks by name.
        failed: {task: reason}, or {point: reason} if no run of it is possible, or a result file of it cannot be read.
        unfinished: number of unfinished replicates by point, those that failed included.
        given_up: the replicates that failed in this session, by point.
        losses: how often a task was lost with its worker without being the cause.
        isolated: name of the task that runs alone, '' if none does.
    """

    folder: Folder
    manifest: Manifest
    engine: engines.Engine
    shard: engines.Shard
    on_progress: Callable[[engines.CampaignProgress], object]
    batch: bool
    access: PluginAccess
    pending: deque[Task] = field(default_factory=deque)
    suspects: deque[Task] = field(default_factory=deque)
    running: dict[str, Task] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    unfinished: Counter[str] = field(default_factory=Counter)
    given_up: defaultdict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    losses: Counter[str] = field(default_factory=Counter)
    isolated: str = ""
    stopped: str = ""
    done: int = 0
    found: int = 0
    worked: float = 0.0
    compiled: float = 0.0

    def __post_init__(self) -> None:
        self.started_at = time.monotonic()
        self.session = session_name()
        self.rule = ReplicateCounts(self.folder, self.manifest)
        self.wanted = {point.id: self.rule.first(point) for point in self.manifest.points}
        self.positions = {point.id: i for i, point in enumerate(self.manifest.points)}
        self.failed_before = {name.rpartition(".r")[0] for name in self.folder.failures()}
        self.code = code_id(self.manifest.code)

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Run tasks until none is left or the campaign is stopped."""
        self.folder.remove_leftovers()
        for point in self.wanted:
            self.plan(point, 0)
        # the first replicates of all points come first, so that an unfinished campaign can already be compared
        self.pending = deque(sorted(self.pending, key=lambda task: task.first))
        try:
            while not self.stopped and (self.pending or self.suspects or self.running):
                if should_stop():
                    self.stopped = "interrupted"
                    break
                self.submit_pending()
                self.settle(self.engine.finished(POLL))
                self.report_progress()
            self.wind_up()
        except engines.EngineError as error:
            self.stopped = str(error)
        self.report_progress()

    def plan(self, point: str, first: int) -> None:
        """Queue tasks for missing replicates of a point, from `first` on. If none is missing, ask the stopping rule."""
        wanted = [number for number in range(first, self.wanted[point]) if self.is_ours(point, number)]
        done = self.folder.done(point)
        missing = [number for number in wanted if number not in done]
        self.found += len(wanted) - len(missing)
        self.queue(point, missing)
        if not missing:
            self.extend_point(point)

    def queue(self, point: str, missing: Sequence[int]) -> None:
        """Queue tasks for these replicates, in order."""
        self.unfinished[point] += len(missing)
        for first, last in consecutive(missing, self.manifest.block):
            self.pending.append(self.task(point, first, last))

    def is_ours(self, point: str, replicate: int) -> bool:
        """Whether the shard has the replicate. With a stopping rule, a point belongs to one shard as a whole."""
        block = 0 if self.manifest.until else replicate // self.manifest.block
        return self.shard.has(self.positions[point], block)

    def task(self, point: str, first: int, last: int) -> Task:
        """A task of this session."""
        folder = str(self.folder.path.resolve())
        timeout = self.manifest.timeout
        return Task(folder, point, first, last, self.session, __version__, timeout, self.batch, self.code, self.access)

    def submit_pending(self) -> None:
        """Submit as many tasks as the engine takes. A suspect is submitted when nothing else runs."""
        while self.pending and not self.isolated and len(self.running) < self.engine.window:
            self.submit(self.pending.popleft())
        if self.suspects and not self.pending and not self.running:
            task = self.suspects.popleft()
            self.isolated = task.name
            self.submit(task)

    def submit(self, task: Task) -> None:
        """Submit a task."""
        self.running[task.name] = task
        self.engine.submit(task)

    def settle(self, finished: Iterable[engines.FinishedTask]) -> None:
        """Process the outcomes of finished tasks."""
        lost = []
        for task, outcome in finished:
            del self.running[task.name]
            if isinstance(outcome, engines.WorkerLost):
                lost.append(task)
            else:
                self.judge(task, outcome, self.end_isolation(task))
        if lost:
            self.investigate(lost)

    def end_isolation(self, task: Task) -> bool:
        """Return whether a finished task ran alone; if so, others may run again."""
        was_isolated = self.isolated == task.name
        if was_isolated:
            self.isolated = ""
        return was_isolated

    def judge(self, task: Task, outcome: TaskOutcome, was_isolated: bool) -> None:
        """Process the outcome that a worker reported."""
        if outcome.status == "cancelled":
            return
        if outcome.status in ("storage", "version"):
            self.stopped = outcome.reason
        elif outcome.status == "suspect":
            self.folder.remove_markers(self.session, task.name)
            if was_isolated:
                self.give_up(task, outcome.reason, isolate=True)
            else:
                self.suspects.append(task)
        elif outcome.status == "impossible" and not self.folder.done(task.point):
            self.give_up_point(task, outcome.reason)
        elif outcome.status in ("failed", "impossible"):
            self.give_up(task, outcome.reason)
        else:
            self.worked, self.compiled = self.worked + outcome.seconds, self.compiled + outcome.compiling
            self.finish(task)

    def finish(self, task: Task) -> None:
        """Count a task whose file exists."""
        self.done += task.replicates
        if task.point in self.failed_before:
            self.folder.forget_failures(task.point, range(task.first, task.last + 1))
        self.unfinished[task.point] -= task.replicates
        self.extend_if_settled(task.point)

    def extend_if_settled(self, point: str) -> None:
        """Ask the stopping rule whether a point needs more replicates, once each of its tasks is done or has failed."""
        if self.unfinished[point] == len(self.given_up[point]):
            self.extend_point(point)

    def extend_point(self, point: str) -> None:
        """Ask the stopping rule whether a point whose tasks are settled needs more replicates, and queue them.

        A file that the rule cannot read is set aside, and its replicates are run again.
        """
        before = self.wanted[point]
        try:
            if self.manifest.until and self.is_ours(point, 0):
                self.wanted[point] = self.rule.next(point, before)
        except ResultError as error:
            if self.folder.set_aside(point):
                missing = [n for n in self.folder.missing(point, before) if n not in self.given_up[point]]
                self.found -= len(missing)
                self.queue(point, missing)
                if not missing:  # other files hold the same replicates
                    self.extend_point(point)
            else:
                self.failed[point] = str(error)
        if self.wanted[point] > before:
            self.plan(point, before)

    def investigate(self, tasks: Iterable[Task]) -> None:
        """Find out from the markers of lost tasks which of them started, and which one killed the workers."""
        found = [(task, self.folder.marker_texts(self.session, task.name)) for task in tasks]
        is_explained = any("".join(markers) for _, markers in found)
        for task, markers in found:
            self.folder.remove_markers(self.session, task.name)
            was_isolated = self.end_isolation(task)
            text = "\n".join(markers)
            if is_timeout(text):
                self.give_up(task, f"took more than {task.timeout:g} s", text)
            elif not markers or (is_explained and not text):  # it had not started, or another task broke the pool
                self.retry(task, was_isolated)
            elif not was_isolated:
                self.suspects.append(task)
            else:
                self.give_up(task, f"killed its worker twice ({cause_of_death(text)})", text, isolate=True)

    def retry(self, task: Task, was_isolated: bool) -> None:
        """Queue again a task that was lost without being the cause. After many losses it is run alone, or fails."""
        self.losses[task.name] += 1
        if self.losses[task.name] >= MAX_LOSSES and was_isolated:
            self.give_up(task, f"was lost with its worker {MAX_LOSSES} times", isolate=True)
        elif was_isolated or self.losses[task.name] >= LOSSES_BEFORE_ISOLATION:
            self.suspects.append(task)
        else:
            self.pending.appendleft(task)

    def give_up(self, task: Task, reason: str, details: str = "", isolate: bool = False) -> None:
        """Split a failed task into tasks of one replicate; if it has only one, write down its failure."""
        if task.replicates > 1:
            done = self.folder.done(task.point)
            missing = [single for single in task.singly() if single.first not in done]
            (self.suspects if isolate else self.pending).extend(missing)
            self.done += task.replicates - len(missing)
            self.unfinished[task.point] -= task.replicates - len(missing)
            self.extend_if_settled(task.point)
            return
        self.failed[task.name] = reason
        self.write_failure(task, reason, details)
        self.given_up[task.point].add(task.first)
        self.extend_if_settled(task.point)

    def give_up_point(self, task: Task, reason: str) -> None:
        """Write down that no run of a task's point is possible, and submit no more of them."""
        point = task.point
        missing = [n for n in self.folder.missing(point, self.wanted[point]) if self.is_ours(point, n)]
        self.pending = deque(each for each in self.pending if each.point != point)
        if point in self.failed or not missing:
            return
        self.given_up[point].update(missing)
        self.failed[point] = f"{reason}; runs with other random numbers fail, too, so that the others were not tried"
        self.write_failure(replace(task, first=missing[0], last=missing[-1]), self.failed[point])

    def write_failure(self, task: Task, reason: str, details: str = "") -> None:
        """Write the report of a failed task: the reason, where it failed, and the texts of its markers."""
        settings = self.manifest.point(task.point).settings
        where = ", ".join([f"replicate {task.first}", *(f"{key} = {value}" for key, value in settings.items())])
        self.folder.write_failure(task.name, "\n".join([reason, where, details[:MAX_MARKER]]).strip() + "\n")

    def wind_up(self) -> None:
        """If the campaign was stopped, start nothing more, and give running tasks some seconds to finish."""
        if self.stopped:
            for task in self.engine.cancel_pending():
                self.running.pop(task.name, None)
        deadline = time.monotonic() + GRACE
        while self.running and time.monotonic() < deadline:
            self.settle(self.engine.finished(POLL))
            self.report_progress()

    def report_progress(self) -> None:
        """Report the progress. Compilation in workers happens once and is excluded from the estimate."""
        wall, unfinished = time.monotonic() - self.started_at, self.unfinished.total()
        failed = sum(map(len, self.given_up.values()))
        total = self.found + self.done + unfinished
        working = wall * (1.0 - self.compiled / self.worked) if self.worked else wall
        left = working / self.done * (unfinished - failed) if self.done else None
        self.on_progress(engines.CampaignProgress(self.found + self.done, failed, total, wall, left))

    def outcome(self) -> engines.CampaignOutcome:
        """The outcome of the session. The missing replicates are looked up on disk."""
        looked_up = ((point, self.folder.missing(point, count)) for point, count in self.wanted.items())
        ours = ((point, [number for number in numbers if self.is_ours(point, number)]) for point, numbers in looked_up)
        missing = {point: numbers for point, numbers in ours if numbers}
        seconds = time.monotonic() - self.started_at
        left_out = dict(self.engine.left_out)
        return engines.CampaignOutcome(self.done, self.found, self.failed, missing, self.stopped, seconds, left_out)
