"""The workers of a Dask scheduler: the connection to it, which of them can run a campaign, and what runs on them.

A scheduler is found by its address or by the file that it wrote. A worker is checked before it gets tasks; those that
are left out are named with the reason.
"""

from __future__ import annotations

import functools
import json
import logging
import queue
import tempfile
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple, final

from wsnsim.base.errors import UsageError
from wsnsim.base.files import read_regular
from wsnsim.base.version import __version__
from wsnsim.campaign.task import Task, TaskOutcome, describe_error, perform
from wsnsim.recording.atomic_files import reason
from wsnsim.recording.provenance import digest_of, package_digests

CONNECT_TIMEOUT: Final = 10.0
"""Seconds to connect to the scheduler."""
WITHOUT_LOG: Final = {"distributed.admin.low-level-log-length": 0}
"""Dask's setting by which a client keeps none of the messages that it sent; it would keep 1000, several megabytes."""


def connected(address: str) -> Any:
    """A client of the scheduler, connected in a thread: Dask would wait forever for a server that is no scheduler.

    Raises:
        UsageError: Dask is not installed, or nothing at the address answers as a scheduler.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'wsnsim[cluster]'") from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # its errors are reported by this engine
    if not address.rpartition(":")[2].isdecimal():  # a client of it would end with a traceback
        raise UsageError(f"cannot connect to the scheduler {address}: expected an address such as tcp://host:8786")
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


def address_in(scheduler_file: Path | None) -> str:
    """The address that a scheduler wrote into its file.

    Raises:
        UsageError: the file does not exist, cannot be read, or is no scheduler's file.
    """
    assert scheduler_file is not None, "either an address or a scheduler file is given"
    try:
        return str(json.loads(read_regular(scheduler_file))["address"])
    except FileNotFoundError:
        raise UsageError(f"scheduler file does not exist: {scheduler_file}") from None
    except OSError as error:
        raise UsageError(f"cannot read {scheduler_file}: {reason(error)}") from None
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{scheduler_file} is not a scheduler file: it contains no address") from None


class WorkerRequirements(NamedTuple):
    """The versions that a worker must have, and a marker file in the campaign's folder that it must see.

    `code` is a digest of the source files of wsnsim that a run can execute; '' for any.
    """

    wsnsim: str
    numpy: str
    marker: str
    code: str = ""


def installed_version() -> str:
    """The version of wsnsim in this process. It is called in the scheduler's process."""
    return __version__


def unmet_requirement(required: WorkerRequirements, dask_worker: Any) -> str:
    """The first requirement that the worker does not meet, '' if it meets all. It runs in the worker's process.

    Args:
        required: versions and marker file of the campaign.
        dask_worker: the worker. The parameter's name is fixed by Dask, which fills it in.
    """
    import numpy

    marker, threads = Path(required.marker), dask_worker.state.nthreads
    if __version__ != required.wsnsim:
        return f"has wsnsim {__version__}, but the campaign runs with {required.wsnsim}"
    if required.code and digest_of(package_digests().items()) != required.code:
        return f"has other source files of wsnsim {__version__} than the campaign: {Path(__file__).parents[1]}"
    if numpy.__version__ != required.numpy:
        return f"has NumPy {numpy.__version__}, but the campaign runs with {required.numpy}: last bits would differ"
    if threads != 1:
        return f"has {threads} threads: start workers with --nthreads 1"
    if not marker.is_file():
        return f"does not see {marker.parents[1]}: the folder must be on a shared file system"
    try:
        with tempfile.TemporaryFile(dir=marker.parent):
            return ""
    except OSError as error:
        return f"cannot write to {marker.parents[1]}: {reason(error)}"


@functools.lru_cache(maxsize=8)
def _unmet_here(required: WorkerRequirements, address: str) -> str:
    """What the worker of this task lacks, '' if nothing; each worker is checked once."""
    from distributed import get_worker

    unmet = unmet_requirement(required, get_worker())
    return f"worker {address} {unmet}" if unmet else ""


def perform_on_worker(task: Task, required: WorkerRequirements) -> TaskOutcome:
    """Perform a task on a Dask worker, which may have joined after the others were checked."""
    from distributed import get_worker

    if unmet := _unmet_here(required, get_worker().address):
        return TaskOutcome("version", unmet)
    return perform(task)


ANSWER_TIMEOUT: Final = 60.0
"""Seconds for an answer of the scheduler, or of the workers through it."""


@final
class DaskWorkers:
    """The workers of a scheduler, as a campaign sees them.

    Attributes:
        usable: addresses of the workers that can run the campaign.
        left_out: {address: why} of those that cannot; they stay here when they have gone.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self.usable: set[str] = set()
        self.left_out: dict[str, str] = {}

    def look(self, required: WorkerRequirements | None) -> None:
        """Find out which workers are there, and check those that are new; without requirements, all can be used."""
        present = set(self._client.nthreads(callback_timeout=ANSWER_TIMEOUT))
        new = present - self.usable - self.left_out.keys()
        self.usable &= present
        unmet = self.unmet(new, required) if new and required else {}
        self.left_out.update(unmet)
        self.usable |= new - unmet.keys()

    def unmet(self, workers: Iterable[str], required: WorkerRequirements) -> dict[str, str]:
        """{address: what it lacks} of those of the workers that do not meet the requirements."""
        chosen = sorted(workers)
        try:
            found = self._client.run(
                unmet_requirement, required, workers=chosen, on_error="return", callback_timeout=ANSWER_TIMEOUT
            )
        except TimeoutError:
            return dict.fromkeys(chosen, "does not answer")
        answers = {worker: one for worker, one in found.items() if one and not isinstance(one, OSError)}  # it has gone
        return {worker: unreadable(one) if isinstance(one, Exception) else one for worker, one in answers.items()}

    def leave_out(self, worker: str, why: str) -> None:
        """Leave a worker out that refused a task."""
        self.usable.discard(worker)
        self.left_out.setdefault(worker, why.removeprefix(f"worker {worker} "))

    def restriction(self) -> list[str] | None:
        """The workers to which tasks are restricted: those that can be used, once one cannot; None for all."""
        return sorted(self.usable) if self.left_out else None


def unreadable(error: Exception) -> str:
    """Why a scheduler or worker cannot use what it receives."""
    return f"cannot read what it receives: is wsnsim {__version__} installed there? ({describe_error(error)})"
