"""The time limit of one run in this process: an exception from a timer, again and again until the run has ended."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Final

from wsnsim.base.errors import RunError, UsageError
from wsnsim.base.plugin_code import plugin_place

AGAIN: Final = 2.0
"""Seconds after which the exception is raised again: compiled code, or a plug-in, may have swallowed it."""


class _TimeIsUp(BaseException):
    """The limit has passed. No `except Exception` of a plug-in catches it."""


@contextlib.contextmanager
def limited(seconds: float | None, what: str) -> Iterator[None]:
    """End the block after some seconds of real time; compiled code first returns.

    Args:
        seconds: The limit; None: there is none.
        what: What takes the time, for the message.

    Raises:
        RunError: The block took longer. The message names the line of a plug-in that ran, if one did.
        UsageError: This is not the main thread of the process, which alone receives a timer's signal.
    """
    if seconds is None:
        yield
        return
    if threading.current_thread() is not threading.main_thread():
        raise UsageError("a timeout needs the main thread of the process")
    before = signal.signal(signal.SIGALRM, _raise)
    signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
    try:
        yield
    except _TimeIsUp as reason:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        place = plugin_place(reason)
        raise RunError(f"{what} took more than {seconds:g} s{f' (at {place})' if place else ''}") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def time_limit(seconds: object) -> float | None:
    """Return a time limit.

    Raises:
        UsageError: It is neither None nor a number of seconds above 0.
    """
    if seconds is None or (
        isinstance(seconds, int | float) and not isinstance(seconds, bool) and seconds > 0.0 and math.isfinite(seconds)
    ):
        return seconds
    raise UsageError(f"timeout: expected a number of seconds greater than 0, or None, not {seconds!r}")


def _raise(number: int, frame: FrameType | None) -> None:
    raise _TimeIsUp
