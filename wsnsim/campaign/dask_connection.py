"""The connection to a Dask scheduler, found by its address or by the file that it wrote."""

from __future__ import annotations

import json
import logging
import queue
import threading
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import UsageError
from wsnsim.base.regular_files import read_regular
from wsnsim.campaign.task import describe_error
from wsnsim.recording.layout import reason

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
