"""The interface between the runner of a campaign and the workers that run its tasks.

An engine accepts tasks and reports how they ended. It does not retry and it does not decide. There are two:
`local_engine.LocalEngine` (processes of this machine) and `dask_engine.DaskEngine` (workers of a Dask scheduler).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from wsnsim.base.errors import WsnsimError
from wsnsim.campaign.task import Task, TaskOutcome


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
