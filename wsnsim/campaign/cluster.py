"""Workers of a Dask scheduler, wherever they are: they need this wsnsim, and to see the campaign's folder.

DaskCluster(address=... or scheduler_file=..., folder=...) is an `engines.Engine`

Distributed is imported here only (extra `cluster`). Results stay on the workers' disk, which is the driver's; what
crosses the network is a task and an outcome, each less than a kilobyte.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import time
from pathlib import Path
from typing import Any, Final, NamedTuple, final

from wsnsim import __version__
from wsnsim.base.errors import UsageError
from wsnsim.campaign.engines import Ending, EngineError, Vanished
from wsnsim.campaign.task import Outcome, Task, perform, words_of

CONNECTING: Final = 20.0
"""s: to reach the scheduler."""
PATIENCE: Final = 300.0
"""s: without any worker, before nobody waits any longer."""
PER_WORKER: Final = 4
RETRIES: Final = 2
REFRESH: Final = 2.0
"""s: between two questions of how many workers there are."""


class Told(NamedTuple):
    """What a worker says of itself."""

    wsnsim: str
    numpy: str
    sees_folder: bool
    can_write: bool


@final
class DaskCluster:
    """A scheduler's workers, one task each at a time. `wait_for`: seconds for the first worker to come.

    Raises:
        UsageError: Dask is not installed, the scheduler cannot be reached, no worker comes, a worker has another wsnsim
            or NumPy, more than one thread, or does not see the folder.
    """

    def __init__(
        self, folder: Path, address: str | None = None, scheduler_file: Path | None = None, wait_for: float = PATIENCE
    ) -> None:
        self._folder = folder
        self._wait_for = wait_for
        self._client = _connected(address, scheduler_file)
        self._name = address or str(scheduler_file)
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: dict[str, tuple[Any, Task]] = {}
        self._asked, self._workers, self._seen = 0.0, 0, time.monotonic()
        try:
            self._demand_workers()
        except BaseException:
            self.close()
            raise

    @property
    def window(self) -> int:
        """Four times as many as there are workers at the moment."""
        if time.monotonic() - self._asked > REFRESH:
            self._count()
        return PER_WORKER * max(1, self._workers)

    def submit(self, task: Task) -> None:
        """Give a task to the scheduler."""
        key = f"{task.session}/{task.name}"
        with self._reachable():
            future = self._client.submit(perform, task, key=key, pure=False, retries=RETRIES)
            self._running[key] = future, task
            future.add_done_callback(self._done.put)

    def ended(self, wait: float) -> list[Ending]:
        """What has ended, each released as it comes."""
        endings = []
        with contextlib.suppress(queue.Empty):
            endings.append(self._ending(self._done.get(timeout=wait)))
            while True:
                endings.append(self._ending(self._done.get_nowait()))
        if not endings:
            self._demand_life()
        return [ending for ending in endings if ending is not None]

    def withdraw(self) -> list[Task]:
        """Take back what is on no worker."""
        with self._reachable():
            begun = {str(key) for keys in self._client.processing().values() for key in keys}
            waiting = [key for key in self._running if key not in begun]
            taken = [self._running.pop(key) for key in waiting]
            self._client.cancel([future for future, _ in taken], force=True)
            return [task for _, task in taken]

    def close(self) -> None:
        """Let go: what still runs is cancelled, which ends no task that a worker has begun."""
        with contextlib.suppress(Exception):
            self._client.cancel([future for future, _ in self._running.values()], force=True)
        self._running.clear()
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)

    def _ending(self, future: Any) -> Ending | None:
        """How a task ended; None for one that was taken back."""
        if future.key not in self._running:
            return None
        if future.status == "cancelled":
            raise EngineError(f"the scheduler {self._name} is gone")
        _, task = self._running.pop(future.key)
        outcome: Outcome | Vanished
        if future.status == "finished":
            outcome = future.result(timeout=CONNECTING)
        else:
            outcome = Vanished(words_of(future.exception(timeout=CONNECTING)))
        future.release()
        return Ending(task, outcome)

    def _demand_life(self) -> None:
        """Raise EngineError if the scheduler is gone, or has had no worker for minutes."""
        if self._client.status != "running":
            raise EngineError(f"the scheduler {self._name} is gone")
        if self._running and time.monotonic() - self._asked > REFRESH:
            self._count()
            if time.monotonic() - self._seen > self._wait_for:
                raise EngineError(f"the scheduler {self._name} has had no worker for {self._wait_for:g} s")

    def _count(self) -> None:
        with self._reachable():
            self._workers = len(self._client.nthreads())
        self._asked = time.monotonic()
        if self._workers:
            self._seen = self._asked

    def _demand_workers(self) -> None:
        """Every worker that is there can do the work; one that comes later says so task by task."""
        try:
            self._client.wait_for_workers(1, timeout=self._wait_for)
            threads = self._client.nthreads()
            told = self._client.run(_tell, str(self._folder.resolve()))
        except TimeoutError:
            raise UsageError(f"the scheduler {self._name} has no worker, after {self._wait_for:g} s") from None
        except Exception as error:
            raise UsageError(
                f"the workers of {self._name} cannot be asked ({words_of(error)}): is this wsnsim installed there?"
            ) from None
        here = _tell(str(self._folder))
        for worker, said in told.items():
            if fault := _fault(said, here, threads.get(worker, 1), self._folder):
                raise UsageError(f"worker {worker} {fault}")

    @contextlib.contextmanager
    def _reachable(self) -> Any:
        try:
            yield
        except Exception as error:
            raise EngineError(f"the scheduler {self._name} is gone ({words_of(error)})") from error


def _connected(address: str | None, scheduler_file: Path | None) -> Any:
    try:
        import distributed
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'wsnsim[cluster]'") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it would say, we say
    if scheduler_file is not None and not scheduler_file.is_file():
        raise UsageError(f"there is no scheduler file {scheduler_file}")
    where: dict[str, Any] = {"scheduler_file": str(scheduler_file)} if scheduler_file else {"address": address}
    try:
        return distributed.Client(**where, timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        raise UsageError(f"the scheduler {address or scheduler_file} cannot be reached: {words_of(error)}") from None


def _tell(folder: str) -> Told:
    """What a worker says of itself; run in its process."""
    import tempfile

    import numpy

    try:
        with tempfile.TemporaryFile(dir=folder):
            can_write = True
    except OSError:
        can_write = False
    return Told(__version__, numpy.__version__, (Path(folder) / "campaign.json").is_file(), can_write)


def _fault(said: Told, here: Told, threads: int, folder: Path) -> str:
    """Why a worker cannot do the work; '' if it can."""
    if said.wsnsim != here.wsnsim:
        return f"has wsnsim {said.wsnsim}, and this is {here.wsnsim}"
    if said.numpy != here.numpy:
        return f"has NumPy {said.numpy}, and here it is {here.numpy}: results would differ in the last bit"
    if threads != 1:
        return f"has {threads} threads: start workers with --nthreads 1"
    if not said.sees_folder:
        return f"does not see {folder}: it must be on a file system that all share"
    return "" if said.can_write else f"cannot write to {folder}"
