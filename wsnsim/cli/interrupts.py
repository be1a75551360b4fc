"""Ctrl-C and SIGTERM: what they do to a run, and to a campaign.

A run is unwound: the handler raises. Compiled code may swallow what is raised, or turn it into another error; so the
signal is kept, and raised again until somebody has taken notice. A campaign is told: the handler only takes note, and
the driver looks.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any, Final, final

AGAIN: Final = 2.0
"""s: after which a signal that has not ended the run is raised again; cleaning up takes far less."""
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@final
class Interrupts:
    """Which signal came, if one did: 0 before."""

    def __init__(self) -> None:
        self.number = 0

    @property
    def code(self) -> int:
        """The exit code of a program that a signal ended."""
        return 128 + self.number

    @property
    def words(self) -> str:
        """What ended the program."""
        return "interrupted" if self.number == signal.SIGINT else "stopped by SIGTERM"

    @contextlib.contextmanager
    def raising(self) -> Iterator[None]:
        """Signals raise KeyboardInterrupt here, until it gets through."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        handlers: dict[int, Callable[..., None]] = dict.fromkeys(SIGNALS, self._raise)
        if hasattr(signal, "setitimer"):
            handlers[signal.SIGALRM] = self._raise_again
        with _handled(handlers):
            try:
                yield
            finally:
                self._disarm()

    @contextlib.contextmanager
    def noted(self) -> Iterator[Callable[[], bool]]:
        """Signals are noted here, and what is yielded says whether one came; a second one raises."""
        if threading.current_thread() is not threading.main_thread():
            yield lambda: False
            return
        with _handled(dict.fromkeys(SIGNALS, self._note)):
            yield lambda: self.number != 0

    def _note(self, number: int, frame: Any) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number

    def _raise(self, number: int, frame: Any) -> None:
        self.number = number
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        raise KeyboardInterrupt

    def _raise_again(self, number: int, frame: Any) -> None:
        if self.number:
            raise KeyboardInterrupt

    @staticmethod
    def _disarm() -> None:
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextlib.contextmanager
def _handled(handlers: dict[int, Callable[..., None]]) -> Iterator[None]:
    """These handlers, and the former ones afterwards."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
