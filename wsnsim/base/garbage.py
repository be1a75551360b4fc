"""Garbage collection of a run: what was there before it is not looked through, and what it leaves is freed at its end.

A run makes many objects and keeps few. Python therefore looks through everything that the process holds every few runs,
which takes a tenth of the time of a short one where large libraries are loaded. What a run leaves behind refers to
itself in circles, so that only a collection frees it.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

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

    def begin(self) -> None:
        """Freeze what is there, unless the caller collects by rules of his own."""
        with self._lock:
            if not self._running:
                self._freezes = gc.isenabled() and gc.get_threshold()[0] > 0 and not gc.get_freeze_count()
                if self._freezes:
                    self._thresholds = first, *others = gc.get_threshold()
                    gc.set_threshold(max(first, NEW_OBJECTS), *others)
                    gc.freeze()
            self._running += 1

    def end(self) -> None:
        """Free what the last of the runs left, and give back what was frozen."""
        with self._lock:
            self._running -= 1
            if self._running or not self._freezes:
                return
            gc.collect()
            gc.unfreeze()
            gc.set_threshold(*self._thresholds)
            self._ended += 1
            if self._ended % EVERYTHING_AFTER == 0:
                gc.collect()


_COLLECTIONS: Final = _Collections()


@contextmanager
def gc_frozen() -> Iterator[None]:
    """Let the garbage collector look only at what is made inside, and free that at the end.

    Nothing changes where the collector is off, or where the caller has frozen objects himself (`gc.freeze`).
    """
    _COLLECTIONS.begin()
    try:
        yield
    finally:
        _COLLECTIONS.end()


@contextmanager
def gc_disabled() -> Iterator[None]:
    """Leave garbage inside until later: imports and scenarios make many objects that stay, and hardly any garbage."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
