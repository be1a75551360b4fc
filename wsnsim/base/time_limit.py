"""The time limit of one run in this process: an exception from a timer, again and again until the run has ended."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Final, TypeVar

from wsnsim.base.errors import RunError, UsageError
from wsnsim.base.plugin_code import plugin_place

Result = TypeVar("Result")
AGAIN: Final = 2.0
"""Seconds after which the exception is raised again: compiled code, or a plug-in, may have swallowed it."""


class _TimeIsUp(BaseException):
    """The limit has passed. No `except Exception` of a plug-in catches it."""


def limited(action: Callable[[], Result], seconds: float | None, what: str) -> Result:
    """Return what an action returns, and end it after some seconds of real time; compiled code first returns.

    Args:
        action: What is done.
        seconds: The limit; None: there is none.
        what: What takes the time, for the message.

    Raises:
        RunError: The action took longer. The message names the line of a plug-in that ran, if one did.
        UsageError: This is not the main thread of the process, which alone receives a timer's signal.
    """
    if seconds is None:
        return action()
    if threading.current_thread() is not threading.main_thread():
        raise UsageError("a timeout needs the main thread of the process")
    ended = False

    def end(number: int, frame: FrameType | None) -> None:
        if not ended:  # a signal may come after the action, before the timer is off
            raise _TimeIsUp

    before = signal.signal(signal.SIGALRM, end)
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
            return action()
        finally:
            ended = True
    except _TimeIsUp as reason:
        ended = True
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
