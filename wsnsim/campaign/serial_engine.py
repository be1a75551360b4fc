"""An engine that runs tasks in this process, one after the other: no workers are started."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from wsnsim.campaign.engines import FinishedTask
from wsnsim.campaign.task import Task, perform


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
