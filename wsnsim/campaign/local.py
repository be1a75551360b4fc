"""Processes of this machine: a pool of spawned workers, made anew after one of them has died.

LocalPool(workers) is an `engines.Engine`
"""

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

from wsnsim.campaign.engines import Ending, EngineError, Vanished
from wsnsim.campaign.task import Outcome, Task, perform, start_worker

MOST_BROKEN: Final = 5
"""Pools in a row of which no worker got as far as to begin: then it is not a task that kills them."""
THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


@final
class LocalPool:
    """`workers` processes, one task each; `perform` is what they do with it."""

    def __init__(self, workers: int, perform: Callable[[Task], Outcome] = perform) -> None:
        self.workers = workers
        self._perform = perform
        self._pool: ProcessPoolExecutor | None = None
        self._running: dict[Future[Outcome], Task] = {}
        self._broken = 0
        self._context: _Remembering | None = None
        self._began: Any = None
        self._told: Any = None

    @property
    def window(self) -> int:
        """Twice as many as there are workers: the next task of each is already with it."""
        return 2 * self.workers

    def submit(self, task: Task) -> None:
        """Give a task to the pool."""
        future: Future[Outcome]
        try:
            with _deaf_to_interrupts():
                future = self._opened().submit(_unless_withdrawn, self._perform, task)
        except BrokenProcessPool as error:  # since it was asked last: what ran in it has ended, and this with it
            future = Future()
            future.set_exception(error)
        self._running[future] = task

    def ended(self, wait_for: float) -> list[Ending]:
        """What has ended; with a pool that broke, all that was under way has."""
        done, _ = wait(self._running, timeout=wait_for, return_when=FIRST_COMPLETED)
        endings = [Ending(self._running.pop(future), _outcome(future)) for future in done]
        if any(isinstance(ending.outcome, Vanished) for ending in endings):
            endings += [Ending(task, _outcome(future)) for future, task in self._running.items()]
            self._running.clear()
            self._drop()
        return endings

    def withdraw(self) -> list[Task]:
        """Tasks that no worker has begun end as withdrawn: the workers are told, as the pool takes nothing back."""
        if self._told is not None:
            self._told.value = 1
        return []

    def close(self) -> None:
        """End the workers, whatever they do."""
        if self._pool is not None:
            self._drop()

    def _opened(self) -> ProcessPoolExecutor:
        if self._pool is None:
            if self._broken >= MOST_BROKEN:
                raise EngineError(
                    f"{self._broken} times in a row workers died before they began: is there enough memory? In a"
                    " script, campaigns must be started under: if __name__ == '__main__':"
                )
            for name in THREADS:
                os.environ.setdefault(name, "1")  # workers read them before they import NumPy
            multiprocessing.resource_tracker.ensure_running()  # which would hear Ctrl-C, and let the workers hear it
            context = self._context = _Remembering()
            self._began, self._told = context.RawValue("b", 0), context.RawValue("b", 0)  # without a lock to die with
            self._pool = ProcessPoolExecutor(
                self.workers, mp_context=context, initializer=_start, initargs=(self._began, self._told)
            )
        return self._pool

    def _drop(self) -> None:
        """Kill what is left of the pool; the next task gets another."""
        assert self._pool is not None and self._context is not None
        self._broken = 0 if self._began.value else self._broken + 1
        pool, self._pool = self._pool, None
        for process in self._context.born:
            if process.is_alive():  # nor is one that could not be started
                process.kill()
        pool.shutdown(wait=True, cancel_futures=True)


class _Remembering(SpawnContext):
    """Spawned processes, and which they are: nobody else's are killed."""

    def __init__(self) -> None:
        super().__init__()
        self.born: list[BaseProcess] = []

    def Process(self, *arguments: Any, **options: Any) -> BaseProcess:  # type: ignore[override]
        """A process that is remembered."""
        process = SpawnProcess(*arguments, **options)
        self.born.append(process)
        return process


_TOLD: list[Any] = []
"""In a worker: the driver's word that no task is to be begun."""


def _start(began: Any, told: Any) -> None:
    _TOLD[:] = [told]
    start_worker(began)


def _unless_withdrawn(perform: Callable[[Task], Outcome], task: Task) -> Outcome:
    return Outcome("withdrawn") if _TOLD and _TOLD[0].value else perform(task)


def cores() -> int:
    """How many processes can run at once: the cores that this one may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started here do not hear Ctrl-C, from their first instruction on; this one hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _outcome(future: Future[Outcome]) -> Outcome | Vanished:
    """How a future ended; one of a pool that broke ends with it."""
    try:
        return future.result(timeout=5.0)
    except Exception as error:
        return Vanished(str(error) or type(error).__name__)
