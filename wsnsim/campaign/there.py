"""What runs on the other side of a Dask scheduler: whether a worker can do the work, and the work itself.

lacks(need, dask_worker) -> what keeps a worker from it;  perform_there(task, need) -> Outcome
"""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.campaign.task import Outcome, Task, perform
from wsnsim.recording.layout import reason


class Need(NamedTuple):
    """What a worker must have: these versions, and sight of the mark that the driver keeps in the campaign's folder."""

    wsnsim: str
    numpy: str
    mark: str


def version_here() -> str:
    """The wsnsim of this process; asked of the scheduler."""
    return __version__


def lacks(need: Need, dask_worker: Any) -> str:
    """What keeps this worker from doing the work; '' if nothing does. Run in its process."""
    import numpy

    mark, threads = Path(need.mark), dask_worker.state.nthreads
    if __version__ != need.wsnsim:
        return f"has wsnsim {__version__}, and the campaign is run by {need.wsnsim}"
    if numpy.__version__ != need.numpy:
        return f"has NumPy {numpy.__version__}, and the driver {need.numpy}: results would differ in the last bit"
    if threads != 1:
        return f"has {threads} threads: start workers with --nthreads 1"
    if not mark.is_file():
        return f"does not see {mark.parents[1]}: it must be on a file system that all share"
    try:
        with tempfile.TemporaryFile(dir=mark.parent):
            return ""
    except OSError as error:
        return f"cannot write to {mark.parents[1]}: {reason(error)}"


@functools.lru_cache(maxsize=8)
def _demand(need: Need) -> None:
    """Raise UsageError if this worker cannot do the work; one that can is asked once."""
    from distributed import get_worker

    worker = get_worker()
    if words := lacks(need, worker):
        raise UsageError(f"worker {worker.address} {words}")


def perform_there(task: Task, need: Need) -> Outcome:
    """`perform`, on a worker that may have come after the others had been asked."""
    try:
        _demand(need)
    except UsageError as error:
        return Outcome("version", str(error))
    return perform(task)
