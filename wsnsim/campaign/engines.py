"""The interface between the runner of a campaign and the workers that run its tasks, and what the runner reports.

An engine accepts tasks and reports how they ended. It does not retry and it does not decide. There are three:
`SerialEngine` (this process, one task after the other), `local_engine.LocalEngine` (processes of this machine) and
`dask_engine.DaskEngine` (workers of a Dask scheduler).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Protocol, final

from wsnsim.base.errors import WsnsimError
from wsnsim.campaign.task import Task, TaskOutcome, perform


class Shard(NamedTuple):
    """One of `total` parts of a campaign, `number` counted from 1."""

    number: int
    total: int

    def has(self, point: int, block: int) -> bool:
        """Whether a block of a point belongs to this shard; both are counted from 0."""
        return (point + block) % self.total == self.number - 1


WHOLE: Final = Shard(1, 1)
"""The only shard of a campaign that is not divided."""


@dataclass(frozen=True, slots=True)
class CampaignProgress:
    """Progress of one session of a campaign.

    Attributes:
        done: replicates on disk, those of earlier sessions included.
        failed: tasks that failed.
        total: all replicates of the shard.
        wall: seconds since the session started.
        left: estimated seconds until the end, None while there is no estimate.
    """

    done: int
    failed: int
    total: int
    wall: float
    left: float | None


@dataclass(frozen=True)
class CampaignOutcome:
    """Outcome of one session of a campaign.

    Attributes:
        done: replicates computed in this session.
        found: replicates that were on disk before.
        failed: {task: reason}; also {point: reason} if a result file of a point cannot be read.
        missing: {point: replicates that are not on disk}.
        stopped: why the session stopped early, '' if it tried every task.
        seconds: duration of the session (s).
        left_out: {worker: why} of workers that joined and could not run the campaign.
    """

    done: int
    found: int
    failed: Mapping[str, str]
    missing: Mapping[str, list[int]]
    stopped: str
    seconds: float
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every replicate of the shard is on disk and nothing failed."""
        return not self.missing and not self.failed


class EngineError(WsnsimError):
    """No further task can be run: the scheduler is gone, or workers die before they start."""


@dataclass(frozen=True, slots=True)
class WorkerLost:
    """The worker of a task died, not necessarily because of the task."""

    reason: str


class FinishedTask(NamedTuple):
    """A task and its outcome."""

    task: Task
    outcome: TaskOutcome | WorkerLost


class Engine(Protocol):
    """Runs tasks on workers."""

    @property
    def window(self) -> int:
        """Number of tasks to submit ahead, so that no worker waits."""
        ...

    @property
    def left_out(self) -> Mapping[str, str]:
        """{worker: why} of the workers that joined and cannot run the campaign."""
        ...

    def submit(self, task: Task) -> None:
        """Accept a task.

        Raises:
            EngineError: no further task can be run.
        """
        ...

    def finished(self, timeout: float) -> list[FinishedTask]:
        """The tasks that finished since the last call; waits up to `timeout` seconds for the first.

        Raises:
            EngineError: no task will ever finish.
        """
        ...

    def cancel_pending(self) -> list[Task]:
        """Cancel the tasks that no worker has started, and return those that will not be reported as finished."""
        ...

    def close(self) -> None:
        """Abandon what still runs. A local engine kills its processes."""
        ...


@final
class SerialEngine:
    """An `engines.Engine` that performs a task when it is asked for finished ones."""

    def __init__(self, workers: int = 1) -> None:
        self.window = 1
        self.left_out: Mapping[str, str] = {}
        self._tasks: list[Task] = []

    def submit(self, task: Task) -> None:
        """Accept a task."""
        self._tasks.append(task)

    def finished(self, timeout: float) -> list[FinishedTask]:
        """Perform the accepted tasks, however long they take."""
        return [FinishedTask(task, perform(task)) for task in self.cancel_pending()]

    def cancel_pending(self) -> list[Task]:
        """Return the accepted tasks, none of which has started."""
        tasks, self._tasks = self._tasks, []
        return tasks

    def close(self) -> None:
        """Nothing to close."""
