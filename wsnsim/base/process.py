"""The process of a run: its garbage, its time limit, and what plug-ins must leave as it is.

A run makes many objects and keeps few. Python therefore looks through everything that the process holds every few runs,
which takes a tenth of the time of a short one where large libraries are loaded. What a run leaves behind refers to
itself in circles, so that only a collection frees it.

A time limit is an exception from a timer, again and again until the run has ended. A plug-in may end the process, close
its streams, or change its working directory: each is refused.
"""

from __future__ import annotations

import contextlib
import gc
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeVar

from wsnsim.base.errors import PluginAnswerError, RunError, UsageError
from wsnsim.base.plugin_code import plugin_place

NEW_OBJECTS: Final = 20_000
"""New objects after which Python looks for garbage: with its default of 700, a few percent of a run's time is that."""
EVERYTHING_AFTER: Final = 50
"""Runs after which everything is looked through once, since freezing objects puts that off."""


class _Collections:
    """The runs of this process that are under way. The first one to begin freezes what is there."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running = 0
        self._freezes = False
        self._thresholds = gc.get_threshold()
        self._ended = 0

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Let the garbage collector look only at what is made inside, and free that at the end.

        Nothing changes where the collector is off, or where the caller has frozen objects himself (`gc.freeze`).
        """
        with self._lock:
            if not self._running:
                self._freezes = gc.isenabled() and gc.get_threshold()[0] > 0 and not gc.get_freeze_count()
                if self._freezes:
                    self._thresholds = first, *others = gc.get_threshold()
                    gc.set_threshold(max(first, NEW_OBJECTS), *others)
                    gc.freeze()
            self._running += 1
        try:
            yield
        finally:
            with self._lock:
                self._running -= 1
                if self._freezes and not self._running:
                    self._thaw()

    def _thaw(self) -> None:
        """Free what the last of the runs left, and give back what was frozen."""
        gc.collect()
        gc.unfreeze()
        gc.set_threshold(*self._thresholds)
        self._ended += 1
        if self._ended % EVERYTHING_AFTER == 0:
            gc.collect()


gc_frozen: Final = _Collections().frozen


@contextmanager
def gc_disabled() -> Iterator[None]:
    """Leave garbage inside until later: imports and scenarios make many objects that stay, and hardly any garbage."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on and not gc.get_freeze_count():
            gc.freeze()
            gc.unfreeze()  # to the oldest generation, where they are not looked through at once
        if was_on:
            gc.enable()


@contextlib.contextmanager
def contained(classes: Sequence[str]) -> Iterator[None]:
    """Report as an error of the run that code of plug-ins ends the process at once, or leaves the working directory.

    Args:
        classes: The classes of plug-ins that take part; none: nothing is done.
    """
    if not classes:
        yield
        return
    end, before = os._exit, _working_directory()
    os._exit = _refusal(end, "calls os._exit({!r}), which ends the whole process without a result")
    try:
        with streams_kept_open():
            yield
    finally:
        os._exit = end
        after = _working_directory()
        if before and after != before:
            os.chdir(before)
    if before and after != before:
        raise PluginAnswerError(f"leaves the working directory {before} for {after}", ", ".join(classes))


@contextlib.contextmanager
def streams_kept_open() -> Iterator[None]:
    """Report as an error that code of plug-ins closes stdout or stderr; what it puts in their place is taken back."""
    held = {name: getattr(sys, name) for name in ("stdout", "stderr")}
    acts = [
        (part, act, name)
        for name, stream in held.items()
        for part in (stream, getattr(stream, "buffer", None))
        for act in ("close", "detach")
        if hasattr(part, "__dict__") and hasattr(part, act)
    ]
    before = [vars(part).get(act) for part, act, _ in acts]
    for part, act, name in acts:
        setattr(part, act, _refusal(getattr(part, act), f"closes sys.{name}, which the whole process uses"))
    try:
        yield
    finally:
        for (part, act, _), one in zip(acts, before, strict=True):
            vars(part).pop(act, None)
            vars(part).update({act: one} if one else {})  # another of these is around this one
        vars(sys).update(held)


def _refusal(act: Callable[..., Any], said: str) -> Callable[..., Any]:
    """What stands in the place of an act: in this process it is an error, a child of a plug-in may do it."""
    process = os.getpid()

    def refuse(*given: Any) -> Any:
        if os.getpid() != process:
            return act(*given)
        raise PluginAnswerError(said.format(*given))

    return refuse


def _working_directory() -> str:
    """The working directory; '' if it was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return ""


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
