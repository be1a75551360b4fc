"""Workers of a Dask scheduler, wherever they are: they need this wsnsim, and to see the campaign's folder.

DaskCluster(address=... or scheduler_file=..., folder=...) is an `engines.Engine`

Distributed is imported here only (extra `cluster`). Results stay on the workers' disk, which is the driver's; what
crosses the network is a task and an outcome, each less than a kilobyte. The scheduler reads what it passes on, so it
needs this wsnsim, too.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import logging
import queue
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, final

from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.campaign.engines import Ending, EngineError, Vanished
from wsnsim.campaign.task import Outcome, Task, words_of
from wsnsim.campaign.there import Need, lacks, perform_there, version_here
from wsnsim.recording.folder import Folder
from wsnsim.recording.layout import reason

CONNECTING: Final = 10.0
"""s: to reach the scheduler."""
ANSWERING: Final = 60.0
"""s: for an answer of the scheduler, or of the workers through it."""
FETCHING: Final = 5.0
"""s: for outcomes, before it is seen whether their workers live."""
PATIENCE: Final = 300.0
"""s: without any worker, before nobody waits any longer."""
REFRESH: Final = 2.0
"""s: between two questions of how many workers there are; 0.1 s while there is none."""
PER_WORKER: Final = 4
RETRIES: Final = 2


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
        self._folder = Folder(folder.resolve())
        self._wait_for = wait_for
        self._name = address or str(scheduler_file)
        self._client = _connected(address or _address_in(scheduler_file))
        self._mark = self._folder.mark("driver", self._client.id)
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: dict[Any, tuple[Any, Task]] = {}
        self._taken: list[Task] = []
        self._numbers = itertools.count()
        self._asked, self._workers, self._seen = 0.0, 0, time.monotonic()
        try:
            self._need = self._marked()
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
        """Take a task: those that were taken go out together when somebody asks what has ended."""
        self._taken.append(task)

    def ended(self, wait: float) -> list[Ending]:
        """What has ended, each released as it comes."""
        with self._reachable():
            self._send()
            futures = [future for future in self._drained(wait) if future.key in self._running]
            if not futures:
                self._demand_life()
            pairs = self._outcomes(futures)
            for future, _ in pairs:
                future.release()
        return [Ending(self._running.pop(future.key)[1], outcome) for future, outcome in pairs]

    def withdraw(self) -> list[Task]:
        """Take back what no worker has begun: there is no mark of it."""
        taken, self._taken = self._taken, []
        waiting = [key for key, (_, task) in self._running.items() if not self._folder.marks(task.session, task.name)]
        dropped = [self._running.pop(key) for key in waiting]
        with self._reachable():
            self._client.cancel([future for future, _ in dropped], force=True)
        return taken + [task for _, task in dropped]

    def close(self) -> None:
        """Let go: what still runs is cancelled, which ends no task that a worker has begun."""
        futures = [future for future, _ in self._running.values()]
        self._running.clear()
        with contextlib.suppress(OSError):
            self._mark.unlink(missing_ok=True)
        with contextlib.suppress(Exception):
            self._client.cancel(futures, force=True)
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)

    def _send(self) -> None:
        """Give the scheduler what was taken, each task under a key that none had before."""
        if not self._taken:
            return
        tasks, self._taken = self._taken, []
        keys = [(f"wsnsim-{task.session}", task.name, next(self._numbers)) for task in tasks]
        futures = self._client.map(perform_there, tasks, need=self._need, key=keys, pure=False, retries=RETRIES)
        self._running.update(zip(keys, zip(futures, tasks, strict=True), strict=True))
        self._listen(futures)

    def _listen(self, futures: Iterable[Any]) -> None:
        for future in futures:
            future.add_done_callback(self._done.put)

    def _drained(self, wait: float) -> list[Any]:
        """The futures that are done."""
        futures = []
        with contextlib.suppress(queue.Empty):
            futures.append(self._done.get(timeout=wait))
            while True:
                futures.append(self._done.get_nowait())
        return futures

    def _outcomes(self, futures: list[Any]) -> list[tuple[Any, Outcome | Vanished]]:
        """What each future holds; one whose worker died with the outcome is listened to again: another repeats it."""
        if any(future.status == "cancelled" for future in futures):
            raise EngineError(f"the scheduler {self._name} is gone")
        finished = [future for future in futures if future.status == "finished"]
        pairs = list(zip(finished, self._fetched(finished), strict=False))
        pairs += [(future, self._failure(future)) for future in futures if future.status == "error"]
        known = {future.key for future, _ in pairs}
        self._listen(future for future in futures if future.key not in known)
        return pairs

    def _fetched(self, futures: list[Any]) -> list[Outcome | Vanished]:
        """The outcomes, all or none, in one question."""
        gather = functools.partial(self._client.gather, futures, errors="skip", asynchronous=True)
        with contextlib.suppress(TimeoutError):
            outcomes = self._client.sync(gather, callback_timeout=FETCHING) if futures else []
            return outcomes if len(outcomes) == len(futures) else []
        return []

    def _failure(self, future: Any) -> Vanished:
        """Workers died. Raises EngineError if a worker cannot even read the task; `perform` itself never raises."""
        from distributed import KilledWorker

        error = future.exception(timeout=FETCHING)
        if not isinstance(error, KilledWorker):
            raise EngineError(_unable(f"a worker of {self._name}", error))
        return Vanished("workers died")

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
            self._workers = len(self._client.nthreads(callback_timeout=ANSWERING))
        self._asked = time.monotonic()
        if self._workers:
            self._seen = self._asked

    def _marked(self) -> Need:
        """What workers need, the driver's mark being in place."""
        import numpy

        try:
            self._mark.parent.mkdir(exist_ok=True)
            self._mark.touch()
        except OSError as error:
            raise UsageError(f"cannot write {self._mark.parent}: {reason(error)}") from None
        return Need(__version__, numpy.__version__, str(self._mark))

    def _demand_workers(self) -> None:
        """Scheduler and workers can do the work; a worker that comes later is asked when it is given its first task."""
        try:
            there = self._client.run_on_scheduler(version_here, callback_timeout=ANSWERING)
            if there != __version__:
                raise EngineError(f"the scheduler {self._name} has wsnsim {there}, and this is {__version__}")
            self._wait_for_one()
            told = self._client.run(lacks, self._need, on_error="return", callback_timeout=ANSWERING)
        except (EngineError, TimeoutError) as error:
            raise UsageError(str(error) or f"the scheduler {self._name} does not answer") from None
        except Exception as error:
            raise UsageError(_unable(f"the scheduler {self._name}", error)) from None
        for worker, said in told.items():
            if said:
                raise UsageError(
                    _unable(f"worker {worker}", said) if isinstance(said, Exception) else f"worker {worker} {said}"
                )

    def _wait_for_one(self) -> None:
        """Until there is a worker."""
        self._count()
        while not self._workers:
            if time.monotonic() - self._seen > self._wait_for:
                raise EngineError(f"the scheduler {self._name} has no worker, after {self._wait_for:g} s")
            time.sleep(0.1)
            self._count()

    @contextlib.contextmanager
    def _reachable(self) -> Iterator[None]:
        """Whatever a question to the scheduler raises means that it is gone, or hangs."""
        try:
            yield
        except EngineError:
            raise
        except TimeoutError:
            raise EngineError(f"the scheduler {self._name} does not answer") from None
        except Exception as error:
            raise EngineError(f"the scheduler {self._name} is gone ({words_of(error)})") from error


def _connected(address: str) -> Any:
    """A client of the scheduler. It is made in a thread: where a stranger listens, Dask would wait for ever."""
    try:
        import distributed
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'wsnsim[cluster]'") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what it would say, we say
    found: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def connect() -> None:
        try:
            found.put(distributed.Client(address, timeout=CONNECTING, set_as_default=False))
        except Exception as error:
            found.put(error)

    threading.Thread(target=connect, daemon=True).start()
    try:
        client = found.get(timeout=1.5 * CONNECTING)
    except queue.Empty:
        raise UsageError(f"{address} does not answer: is a Dask scheduler there?") from None
    if isinstance(client, Exception):
        raise UsageError(f"the scheduler {address} cannot be reached: {words_of(client)}")
    return client


def _address_in(scheduler_file: Path | None) -> str:
    """Where the scheduler is that wrote the file."""
    assert scheduler_file is not None, "a scheduler is known by its address or by its file"
    try:
        return str(json.loads(scheduler_file.read_text(encoding="utf-8"))["address"])
    except FileNotFoundError:
        raise UsageError(f"there is no scheduler file {scheduler_file}") from None
    except OSError as error:
        raise UsageError(f"cannot read {scheduler_file}: {reason(error)}") from None
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{scheduler_file} is no scheduler file: it names no address") from None


def _unable(who: str, error: Exception) -> str:
    return f"{who} cannot read what it is sent: is wsnsim {__version__} installed there? ({words_of(error)})"
