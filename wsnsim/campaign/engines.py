"""The interface between the runner of a campaign and the workers that run its tasks, and what the runner reports.

An engine accepts tasks and reports how they ended. It does not retry and it does not decide. There are three:
`SerialEngine` (this process, one task after the other), `LocalEngine` (processes of this machine: a pool, replaced when
a worker dies) and `dask_engine.DaskEngine` (workers of a Dask scheduler).

Workers are copies of this process where that is safe, which saves each of them the imports. Elsewhere they are spawned.
"""

from __future__ import annotations

import contextlib
import contextvars
import multiprocessing.resource_tracker
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol, cast, final

from wsnsim.base.errors import WsnsimError
from wsnsim.campaign.task import Task, TaskOutcome, perform, start_worker


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
        failed: replicates that failed.
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
        failed: {task: reason}; {point: reason} if no run of a point is possible, or a result file of it cannot be read.
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

    @property
    def left_out(self) -> Mapping[str, str]:
        """{worker: why} of the workers that joined and cannot run the campaign."""

    def submit(self, task: Task) -> None:
        """Accept a task.

        Raises:
            EngineError: no further task can be run.
        """

    def finished(self, timeout: float) -> list[FinishedTask]:
        """The tasks that finished since the last call; waits up to `timeout` seconds for the first.

        Raises:
            EngineError: no task will ever finish.
        """

    def cancel_pending(self) -> list[Task]:
        """Cancel the tasks that no worker has started, and return those that will not be reported as finished."""

    def close(self) -> None:
        """Abandon what still runs. A local engine kills its processes."""


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
        self.workers, self.left_out = workers, dict[str, str]()
        self.window = 2 * workers  # so that the next task of each is already in its queue
        self._perform = perform
        self._pool: ProcessPoolExecutor | None = None
        self._running: dict[Future[TaskOutcome], Task] = {}
        self._broken_pools = 0
        self._context: _RecordingContext | None = None
        self._started: Any = None
        self._cancelled: Any = None

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
            context = self._context = _RecordingContext("fork" if _can_be_copied() else "spawn")
            # RawValue has no lock, which a dying worker could leave locked
            self._started, self._cancelled = context.RawValue("b", 0), context.RawValue("b", 0)
            self._pool = ProcessPoolExecutor(
                self.workers,
                mp_context=cast(BaseContext, context),
                initializer=_start,
                initargs=(self._started, self._cancelled),
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


class _RecordingContext:
    """A context of multiprocessing that records its processes, so that no other process is killed."""

    def __init__(self, method: str) -> None:
        self._context: Any = multiprocessing.get_context(method)
        self.started: list[BaseProcess] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def Process(self, *arguments: Any, **options: Any) -> BaseProcess:
        """A new process, recorded."""
        process: BaseProcess = self._context.Process(*arguments, **options)
        self.started.append(process)
        return process


def _can_be_copied() -> bool:
    """Whether a copy of this process works: it has no other thread, whose locks nobody would release in the copy.

    Threads that Python does not know, such as those of a linear algebra library, count as well. Linux lists them; on
    other systems libraries of the system may not survive the copy.
    """
    return sys.platform == "linux" and len(list(Path("/proc/self/task").iterdir())) == 1


_CANCELLED: list[Any] = []
"""In a worker: the shared flag that stops it from starting further tasks."""


def _start(started: Any, cancelled: Any) -> None:
    _CANCELLED[:] = [cancelled]
    start_worker(started)


def _unless_cancelled(perform: Callable[[Task], TaskOutcome], task: Task) -> TaskOutcome:
    """Perform a task unless the campaign stops. Its progress is not for whoever watches that of the copied process."""
    if _CANCELLED and _CANCELLED[0].value:
        return TaskOutcome("cancelled")
    return contextvars.Context().run(perform, task)


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block signals that end a campaign, so that processes started meanwhile ignore them from the first instruction.

    Terminals send Ctrl-C and SIGHUP, and cluster schedulers SIGTERM, to all processes at once.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
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
