"""An engine that runs tasks in processes of this machine: a pool of spawned workers, replaced when a worker dies."""

from __future__ import annotations

import contextlib
import multiprocessing.resource_tracker
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from typing import Any, Final, final

from wsnsim.campaign.engines import EngineError, FinishedTask, WorkerLost
from wsnsim.campaign.task import Task, TaskOutcome, perform, start_worker

MAX_BROKEN_POOLS: Final = 5
"""Stop after this many consecutive pools in which no worker started: then the tasks are not the cause."""
THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


@final
class LocalEngine:
    """An `engines.Engine` of local processes.

    Args:
        workers: number of processes; each runs one task at a time.
        perform: what a process does with a task.
    """

    def __init__(self, workers: int, perform: Callable[[Task], TaskOutcome] = perform) -> None:
        self.workers = workers
        self._perform = perform
        self._pool: ProcessPoolExecutor | None = None
        self._running: dict[Future[TaskOutcome], Task] = {}
        self._broken_pools = 0
        self._context: _RecordingContext | None = None
        self._started: Any = None
        self._cancelled: Any = None

    @property
    def window(self) -> int:
        """Twice the number of workers, so that the next task of each is already in its queue."""
        return 2 * self.workers

    def submit(self, task: Task) -> None:
        """Submit a task to the pool.

        Raises:
            EngineError: no worker can be started.
        """
        future: Future[TaskOutcome]
        try:
            with _interrupts_blocked():
                future = self._open_pool().submit(_unless_cancelled, self._perform, task)
        except BrokenProcessPool as error:  # a worker has died since the last call: this task is lost with the pool
            future = Future()
            future.set_exception(error)
        self._running[future] = task

    def finished(self, timeout: float) -> list[FinishedTask]:
        """The tasks that finished. If the pool broke, these are all running tasks."""
        done, _ = wait(self._running, timeout=timeout, return_when=FIRST_COMPLETED)
        ended = [FinishedTask(self._running.pop(future), _outcome(future)) for future in done]
        if any(isinstance(each.outcome, WorkerLost) for each in ended):
            ended += [FinishedTask(task, _outcome(future)) for future, task in self._running.items()]
            self._running.clear()
            self._drop()
        return ended

    def cancel_pending(self) -> list[Task]:
        """Let tasks that no worker has started finish as cancelled; the executor cannot take them back."""
        if self._cancelled is not None:
            self._cancelled.value = 1
        return []

    def close(self) -> None:
        """Kill the workers."""
        if self._pool is not None:
            self._drop()

    def _open_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            if self._broken_pools >= MAX_BROKEN_POOLS:
                raise EngineError(
                    f"workers died {self._broken_pools} times in a row before they started: is there enough memory? A"
                    " script must start a campaign under: if __name__ == '__main__':"
                )
            for name in THREADS:
                os.environ.setdefault(name, "1")  # workers read them before they import NumPy
            # started before the workers, which would otherwise start it and pass Ctrl-C on to it
            multiprocessing.resource_tracker.ensure_running()
            context = self._context = _RecordingContext()
            # RawValue has no lock, which a dying worker could leave locked
            self._started, self._cancelled = context.RawValue("b", 0), context.RawValue("b", 0)
            self._pool = ProcessPoolExecutor(
                self.workers, mp_context=context, initializer=_start, initargs=(self._started, self._cancelled)
            )
        return self._pool

    def _drop(self) -> None:
        """Kill the remaining workers of the pool. The next task starts a new pool."""
        assert self._pool is not None and self._context is not None, "only an open pool is dropped"
        self._broken_pools = 0 if self._started.value else self._broken_pools + 1
        pool, self._pool = self._pool, None
        for process in self._context.started:
            if process.is_alive():  # False for a process that could not be started
                process.kill()
        pool.shutdown(wait=True, cancel_futures=True)


class _RecordingContext(SpawnContext):
    """A spawn context that records its processes, so that no other process is killed."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[BaseProcess] = []

    def Process(self, *arguments: Any, **options: Any) -> BaseProcess:  # type: ignore[override]
        """A new process, recorded."""
        process = SpawnProcess(*arguments, **options)
        self.started.append(process)
        return process


_CANCELLED: list[Any] = []
"""In a worker: the shared flag that stops it from starting further tasks."""


def _start(started: Any, cancelled: Any) -> None:
    _CANCELLED[:] = [cancelled]
    start_worker(started)


def _unless_cancelled(perform: Callable[[Task], TaskOutcome], task: Task) -> TaskOutcome:
    return TaskOutcome("cancelled") if _CANCELLED and _CANCELLED[0].value else perform(task)


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C here, so that processes started meanwhile ignore it from their first instruction."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _outcome(future: Future[TaskOutcome]) -> TaskOutcome | WorkerLost:
    """The outcome of a future; `WorkerLost` if its pool broke."""
    try:
        return future.result(timeout=5.0)
    except Exception as error:
        return WorkerLost(str(error) or type(error).__name__)
