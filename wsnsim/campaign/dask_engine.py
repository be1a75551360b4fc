"""An engine that runs tasks on the workers of a Dask scheduler.

Workers and scheduler need this version of wsnsim, and the workers must see the campaign's folder. Only this module and
`dask_workers` import distributed (extra `cluster`). Results are written to the shared folder; only tasks and outcomes
cross the network, each smaller than a kilobyte.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import queue
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, final

from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.campaign.dask_workers import (
    ANSWER_TIMEOUT,
    DaskWorkers,
    WorkerRequirements,
    address_in,
    connected,
    installed_version,
    perform_on_worker,
    unreadable,
)
from wsnsim.campaign.engines import EngineError, FinishedTask, WorkerLost
from wsnsim.campaign.task import Task, TaskOutcome, describe_error
from wsnsim.recording.atomic_files import reason
from wsnsim.recording.folder import Folder
from wsnsim.recording.provenance import digest_of, package_digests

FETCH_TIMEOUT: Final = 5.0
"""Seconds to fetch outcomes, before the engine checks whether their workers are alive."""
WORKER_TIMEOUT: Final = 300.0
"""Seconds without any worker after which the engine fails."""
REFRESH: Final = 2.0
"""Seconds between two counts of the workers; 0.1 s while there is none."""
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
        self._client = connected(address or address_in(scheduler_file))
        self._marker = self._folder.marker("driver", self._client.id)
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: dict[Any, tuple[Any, Task]] = {}
        self._restricted: dict[Any, frozenset[str]] = {}
        self._accepted: list[Task] = []
        self._numbers = itertools.count()
        self._workers = DaskWorkers(self._client)
        self._required: WorkerRequirements | None = None
        self._counted_at, self._worker_seen_at = 0.0, time.monotonic()
        try:
            self._check_workers(self._write_marker())
        except BaseException:
            self.close()
            raise

    @property
    def window(self) -> int:
        """Four times the current number of workers that can be used."""
        if time.monotonic() - self._counted_at > REFRESH:
            self._look_at_workers()
        return PER_WORKER * max(1, len(self._workers.usable))

    @property
    def left_out(self) -> Mapping[str, str]:
        """{address: why} of the workers that joined and cannot run the campaign."""
        return self._workers.left_out

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
            pairs = [pair for pair in self._outcomes(futures) if not self._is_refused(*pair)]
            for future, _ in pairs:
                future.release()
        return [FinishedTask(self._popped(future.key)[1], outcome) for future, outcome in pairs]

    def cancel_pending(self) -> list[Task]:
        """Cancel and return the tasks that no worker has started: those without a marker file."""
        accepted, self._accepted = self._accepted, []
        waiting = [key for key, (_, task) in self._running.items() if not self._folder.markers(task.session, task.name)]
        dropped = [self._popped(key) for key in waiting]
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
        only = self._workers.restriction()
        futures = self._client.map(
            perform_on_worker, tasks, required=self._required, key=keys, pure=False, retries=RETRIES, workers=only
        )
        self._running.update(zip(keys, zip(futures, tasks, strict=True), strict=True))
        self._restricted.update(dict.fromkeys(keys, frozenset(only)) if only is not None else {})
        self._listen(futures)

    def _popped(self, key: Any) -> tuple[Any, Task]:
        """Forget a task that was sent; its future and itself."""
        self._restricted.pop(key, None)
        return self._running.pop(key)

    def _send_again(self, keys: Iterable[Any]) -> None:
        """Take tasks back, and accept them again, for workers that can be used."""
        taken = [self._popped(key) for key in keys]
        self._client.cancel([future for future, _ in taken], force=True)
        self._accepted += [task for _, task in taken]

    def _is_refused(self, future: Any, outcome: TaskOutcome | WorkerLost) -> bool:
        """Whether a worker refused a task that another worker can run. It is left out, and the task is sent again."""
        if not isinstance(outcome, TaskOutcome) or outcome.status != "version":
            return False
        for workers in self._client.who_has([future]).values():
            for worker in workers:
                self._workers.leave_out(worker, outcome.reason)
        if not self._workers.usable:
            return False
        self._send_again([future.key])
        return True

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
        pairs += [(future, self._lost_worker(future)) for future in self._erred(futures)]
        known = {future.key for future, _ in pairs}
        self._listen(future for future in futures if future.key not in known and future.key in self._running)
        return pairs

    def _fetched(self, futures: list[Any]) -> list[TaskOutcome | WorkerLost]:
        """The outcomes of all futures, fetched with one call; [] if one cannot be fetched."""
        gather = functools.partial(self._client.gather, futures, errors="skip", asynchronous=True)
        with contextlib.suppress(TimeoutError):
            outcomes = self._client.sync(gather, callback_timeout=FETCH_TIMEOUT) if futures else []
            return outcomes if len(outcomes) == len(futures) else []
        return []

    def _erred(self, futures: list[Any]) -> list[Any]:
        """The futures with an error, without those that a worker could not read which is left out now: sent again."""
        erred = [future for future in futures if future.status == "error"]
        free = [future for future in erred if future.key not in self._restricted and not _is_killed(future)]
        if free:
            self._look_at_workers()
        if not free or not self._workers.left_out or not self._workers.usable:
            return erred
        self._send_again([future.key for future in free])
        return [future for future in erred if future.key in self._running]

    def _lost_worker(self, future: Any) -> WorkerLost:
        """The loss of a future's workers. Another error means that no worker can read the task."""
        if not _is_killed(future):
            error = future.exception(timeout=FETCH_TIMEOUT)
            raise EngineError(f"a worker of {self._name} {unreadable(error)}")
        return WorkerLost("workers died")

    def _check_scheduler(self) -> None:
        """Raise EngineError if the scheduler is gone, or has had no worker for minutes."""
        if self._client.status != "running":
            raise EngineError(f"{self._name} is gone")
        if self._running and time.monotonic() - self._counted_at > REFRESH:
            self._look_at_workers()
            if time.monotonic() - self._worker_seen_at > self._wait_for:
                raise EngineError(f"{self._name} has had no worker for {self._wait_for:g} s")

    def _look_at_workers(self) -> None:
        """Check workers that have joined, and send tasks again that only workers may run that have gone."""
        with self._scheduler_errors():
            self._workers.look(self._required)
            usable = self._workers.usable
            self._counted_at = time.monotonic()
            if usable:
                self._worker_seen_at = self._counted_at
                self._send_again([key for key, only in self._restricted.items() if not only & usable])

    def _write_marker(self) -> WorkerRequirements:
        """Write the marker file of this session; return what workers must meet."""
        import numpy

        try:
            self._marker.parent.mkdir(exist_ok=True)
            self._marker.touch()
        except OSError as error:
            raise UsageError(f"cannot write {self._marker.parent}: {reason(error)}") from None
        code = digest_of(package_digests().items())
        return WorkerRequirements(__version__, numpy.__version__, str(self._marker), code)

    def _check_workers(self, required: WorkerRequirements) -> None:
        """Check scheduler and workers. A worker that joins later is checked then, and left out."""
        try:
            version = self._client.run_on_scheduler(installed_version, callback_timeout=ANSWER_TIMEOUT)
            if version != __version__:
                raise EngineError(f"{self._name} has wsnsim {version}, but this is {__version__}")
            self._wait_for_worker()
            unmet = self._workers.unmet(self._workers.usable, required)
        except (EngineError, TimeoutError) as error:
            raise UsageError(str(error) or f"{self._name} does not answer") from None
        except Exception as error:
            raise UsageError(f"{self._name} {unreadable(error)}") from None
        for worker, lack in unmet.items():
            raise UsageError(f"worker {worker} {lack}")
        self._required = required

    def _wait_for_worker(self) -> None:
        self._look_at_workers()
        while not self._workers.usable:
            if time.monotonic() - self._worker_seen_at > self._wait_for:
                raise EngineError(f"{self._name} has no worker after {self._wait_for:g} s")
            time.sleep(0.1)
            self._look_at_workers()

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


def _is_killed(future: Any) -> bool:
    """Whether a future's error is that its workers died. `perform` never raises: another error is one of reading."""
    from distributed import KilledWorker

    return isinstance(future.exception(timeout=FETCH_TIMEOUT), KilledWorker)
