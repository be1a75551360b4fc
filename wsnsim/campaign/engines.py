"""The seam between a campaign and whoever runs its tasks.

An engine is given tasks and says how they ended; it neither retries nor decides. Two are enough: `local.LocalPool`,
processes of this machine, and `cluster.DaskCluster`, workers of a Dask scheduler.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from wsnsim.base.errors import WsnsimError
from wsnsim.campaign.task import Outcome, Task


class EngineError(WsnsimError):
    """No task can be run any more: the scheduler is gone, or workers die before they begin."""


@dataclass(frozen=True, slots=True)
class Vanished:
    """The worker that a task was given to is gone, whoever's fault it was."""

    words: str


class Ending(NamedTuple):
    """A task, and how it ended."""

    task: Task
    outcome: Outcome | Vanished


class Engine(Protocol):
    """Whoever runs tasks."""

    @property
    def window(self) -> int:
        """How many tasks to have under way, so that no worker waits."""
        ...

    def submit(self, task: Task) -> None:
        """Take a task. Raises EngineError if none can be taken."""
        ...

    def ended(self, wait: float) -> list[Ending]:
        """The tasks that have ended since the last call; if there are none, whatever ends within `wait` seconds.

        Raises:
            EngineError: none will ever end.
        """
        ...

    def withdraw(self) -> list[Task]:
        """Take back the tasks that no worker has begun."""
        ...

    def close(self) -> None:
        """Let go of what still runs: a process of this machine is killed."""
        ...
