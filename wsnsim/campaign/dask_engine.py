"""An engine that runs tasks on the workers of a Dask scheduler.

Workers and scheduler need this version of wsnsim, and the workers must see the campaign's folder. Only this module and
`dask_worker` import distributed (extra `cluster`). Results are written to the shared folder; only tasks and outcomes
cross the network, each smaller than a kilobyte.
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
from wsnsim.base.regular_files import read_regular
from wsnsim.base.version import __version__
from wsnsim.campaign.dask_worker import WorkerRequirements, installed_version, perform_on_worker, unmet_requirement
from wsnsim.campaign.engines import EngineError, FinishedTask, WorkerLost
from wsnsim.campaign.task import Task, TaskOutcome, describe_error
from wsnsim.recording.folder import Folder
from wsnsim.recording.layout import reason

CONNECT_TIMEOUT: Final = 10.0
"""Seconds to connect to the scheduler."""
ANSWER_TIMEOUT: Final = 60.0
"""Seconds for an answer of the scheduler, or of the workers through it."""
FETCH_TIMEOUT: Final = 5.0
"""Seconds to fetch outcomes, before the engine checks whether their workers are alive."""
WORKER_TIMEOUT: Final = 300.0
"""Seconds without any worker after which the engine fails."""
REFRESH: Final = 2.0
"""Seconds between two counts of the workers; 0.1 s while there is none."""
WITHOUT_LOG: Final = {"distributed.admin.low-level-log-length": 0}
"""Dask's setting by which a client keeps none of the messages that it sent; it would keep 1000, several megabytes."""
PER_WORKER: Final = 4
RETRIES: Final = 2


@final
class DaskEngine:
    """An `engines.Engine` of a scheduler's workers, which run one task each at a time.

    Args:
        folder: the campaign's folder.
        address: address of the scheduler, such as tcp://host:8786.
        scheduler_file: the file in which a scheduler wrote its address, instead of `address`.
        wait_for: seconds to wait for the first worker.

    Raises:
        UsageError: Dask is not installed, the scheduler cannot be reached, there is no worker, or a worker has another
            version of wsnsim or NumPy, more than one thread, or does not see the folder.
    """

    def __init__(
        self,
        folder: Path,
        address: str | None = None,
        scheduler_file: Path | None = None,
        wait_for: float = WORKER_TIMEOUT,
    ) -> None:
        self._folder = Folder(folder.resolve())
        self._wait_for = wait_for
        self._name = f"the scheduler {address or scheduler_file}"
        self._client = _connected(address or _address_in(scheduler_file))
        self._marker = self._folder.marker("driver", self._client.id)
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: dict[Any, tuple[Any, Task]] = {}
        self._accepted: list[Task] = []
        self._numbers = itertools.count()
        self._counted_at, self._workers, self._worker_seen_at = 0.0, 0, time.monotonic()
        try:
            self._required = self._write_marker()
            self._check_workers()
        except BaseException:
            self.close()
            raise

    @property
    def window(self) -> int:
        """Four times the current number of workers."""
        if time.monotonic() - self._counted_at > REFRESH:
            self._count_workers()
        return PER_WORKER * max(1, self._workers)

    def submit(self, task: Task) -> None:
        """Accept a task. Accepted tasks are sent together at the next call of `finished`."""
        self._accepted.append(task)

    def finished(self, timeout: float) -> list[FinishedTask]:
        """The tasks that finished.

        Raises:
            EngineError: the scheduler is gone, has no worker, or has workers that cannot read a task.
        """
        with self._scheduler_errors():
            self._send()
            futures = [future for future in self._drained(timeout) if future.key in self._running]
            if not futures:
                self._check_scheduler()
            pairs = self._outcomes(futures)
            for future, _ in pairs:
                future.release()
        return [FinishedTask(self._running.pop(future.key)[1], outcome) for future, outcome in pairs]

    def cancel_pending(self) -> list[Task]:
        """Cancel and return the tasks that no worker has started: those without a marker file."""
        accepted, self._accepted = self._accepted, []
        waiting = [key for key, (_, task) in self._running.items() if not self._folder.markers(task.session, task.name)]
        dropped = [self._running.pop(key) for key in waiting]
        with self._scheduler_errors():
            self._client.cancel([future for future, _ in dropped], force=True)
        return accepted + [task for _, task in dropped]

    def close(self) -> None:
        """Cancel everything and disconnect. A task that a worker has started still runs to its end."""
        futures = [future for future, _ in self._running.values()]
        self._running.clear()
        with contextlib.suppress(OSError):
            self._marker.unlink(missing_ok=True)
        with contextlib.suppress(Exception):
            self._client.cancel(futures, force=True)
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)

    def _send(self) -> None:
        """Send the accepted tasks to the scheduler, each under a new key."""
        if not self._accepted:
            return
        tasks, self._accepted = self._accepted, []
        keys = [(f"wsnsim-{task.session}", task.name, next(self._numbers)) for task in tasks]
        futures = self._client.map(
            perform_on_worker, tasks, required=self._required, key=keys, pure=False, retries=RETRIES
        )
        self._running.update(zip(keys, zip(futures, tasks, strict=True), strict=True))
        self._listen(futures)

    def _listen(self, futures: Iterable[Any]) -> None:
        for future in futures:
            future.add_done_callback(self._done.put)

    def _drained(self, timeout: float) -> list[Any]:
        """The futures that are done."""
        futures = []
        with contextlib.suppress(queue.Empty):
            futures.append(self._done.get(timeout=timeout))
            while True:
                futures.append(self._done.get_nowait())
        return futures

    def _outcomes(self, futures: list[Any]) -> list[tuple[Any, TaskOutcome | WorkerLost]]:
        """The outcome of each future. If a worker died with an outcome, Dask runs the task again: listen again."""
        if any(future.status == "cancelled" for future in futures):
            raise EngineError(f"{self._name} is gone")
        finished = [future for future in futures if future.status == "finished"]
        pairs = list(zip(finished, self._fetched(finished), strict=False))
        pairs += [(future, self._lost_worker(future)) for future in futures if future.status == "error"]
        known = {future.key for future, _ in pairs}
        self._listen(future for future in futures if future.key not in known)
        return pairs

    def _fetched(self, futures: list[Any]) -> list[TaskOutcome | WorkerLost]:
        """The outcomes of all futures, fetched with one call; [] if one cannot be fetched."""
        gather = functools.partial(self._client.gather, futures, errors="skip", asynchronous=True)
        with contextlib.suppress(TimeoutError):
            outcomes = self._client.sync(gather, callback_timeout=FETCH_TIMEOUT) if futures else []
            return outcomes if len(outcomes) == len(futures) else []
        return []

    def _lost_worker(self, future: Any) -> WorkerLost:
        """The loss of a future's workers. `perform` never raises: another error means that a worker cannot read it."""
        from distributed import KilledWorker

        error = future.exception(timeout=FETCH_TIMEOUT)
        if not isinstance(error, KilledWorker):
            raise EngineError(_unreadable(f"a worker of {self._name}", error))
        return WorkerLost("workers died")

    def _check_scheduler(self) -> None:
        """Raise EngineError if the scheduler is gone, or has had no worker for minutes."""
        if self._client.status != "running":
            raise EngineError(f"{self._name} is gone")
        if self._running and time.monotonic() - self._counted_at > REFRESH:
            self._count_workers()
            if time.monotonic() - self._worker_seen_at > self._wait_for:
                raise EngineError(f"{self._name} has had no worker for {self._wait_for:g} s")

    def _count_workers(self) -> None:
        with self._scheduler_errors():
            self._workers = len(self._client.nthreads(callback_timeout=ANSWER_TIMEOUT))
        self._counted_at = time.monotonic()
        if self._workers:
            self._worker_seen_at = self._counted_at

    def _write_marker(self) -> WorkerRequirements:
        """Write the marker file of this session; return what workers must meet."""
        import numpy

        try:
            self._marker.parent.mkdir(exist_ok=True)
            self._marker.touch()
        except OSError as error:
            raise UsageError(f"cannot write {self._marker.parent}: {reason(error)}") from None
        return WorkerRequirements(__version__, numpy.__version__, str(self._marker))

    def _check_workers(self) -> None:
        """Check scheduler and workers. A worker that joins later is checked with its first task."""
        try:
            version = self._client.run_on_scheduler(installed_version, callback_timeout=ANSWER_TIMEOUT)
            if version != __version__:
                raise EngineError(f"{self._name} has wsnsim {version}, but this is {__version__}")
            self._wait_for_worker()
            unmet = self._client.run(
                unmet_requirement, self._required, on_error="return", callback_timeout=ANSWER_TIMEOUT
            )
        except (EngineError, TimeoutError) as error:
            raise UsageError(str(error) or f"{self._name} does not answer") from None
        except Exception as error:
            raise UsageError(_unreadable(self._name, error)) from None
        for worker, found in unmet.items():
            if isinstance(found, Exception):
                raise UsageError(_unreadable(f"worker {worker}", found))
            if found:
                raise UsageError(f"worker {worker} {found}")

    def _wait_for_worker(self) -> None:
        self._count_workers()
        while not self._workers:
            if time.monotonic() - self._worker_seen_at > self._wait_for:
                raise EngineError(f"{self._name} has no worker after {self._wait_for:g} s")
            time.sleep(0.1)
            self._count_workers()

    @contextlib.contextmanager
    def _scheduler_errors(self) -> Iterator[None]:
        """Turn every error of a call to the scheduler into an EngineError: it is gone, or it hangs."""
        try:
            yield
        except EngineError:
            raise
        except TimeoutError:
            raise EngineError(f"{self._name} does not answer") from None
        except Exception as error:
            raise EngineError(f"{self._name} is gone ({describe_error(error)})") from error


def _connected(address: str) -> Any:
    """A client of the scheduler, connected in a thread: Dask would wait forever for a server that is no scheduler."""
    try:
        import dask
        import distributed
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'wsnsim[cluster]'") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # its errors are reported by this engine
    client_class: Any = distributed.Client
    found: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def connect() -> None:
        try:
            with dask.config.set(WITHOUT_LOG):
                found.put(client_class(address, timeout=CONNECT_TIMEOUT, set_as_default=False))
        except Exception as error:
            found.put(error)

    threading.Thread(target=connect, daemon=True).start()
    try:
        client = found.get(timeout=1.5 * CONNECT_TIMEOUT)
    except queue.Empty:
        raise UsageError(f"{address} does not answer: is it the address of a Dask scheduler?") from None
    if isinstance(client, Exception):
        raise UsageError(f"cannot connect to the scheduler {address}: {describe_error(client)}")
    return client


def _address_in(scheduler_file: Path | None) -> str:
    """The address that a scheduler wrote into its file."""
    assert scheduler_file is not None, "either an address or a scheduler file is given"
    try:
        return str(json.loads(read_regular(scheduler_file))["address"])
    except FileNotFoundError:
        raise UsageError(f"scheduler file does not exist: {scheduler_file}") from None
    except OSError as error:
        raise UsageError(f"cannot read {scheduler_file}: {reason(error)}") from None
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{scheduler_file} is not a scheduler file: it contains no address") from None


def _unreadable(receiver: str, error: Exception) -> str:
    return (
        f"{receiver} cannot read what it receives: is wsnsim {__version__} installed there? ({describe_error(error)})"
    )
