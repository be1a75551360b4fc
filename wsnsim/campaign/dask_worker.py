"""What runs on the workers of a Dask scheduler: a check of the worker, and the task itself."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from wsnsim.base.version import __version__
from wsnsim.campaign.task import Task, TaskOutcome, perform
from wsnsim.recording.layout import reason
from wsnsim.recording.provenance import digest_of, package_digests


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
        return f"has other source files of wsnsim {__version__} than the campaign"
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
