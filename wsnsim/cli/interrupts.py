"""Signals and streams: Ctrl-C, SIGTERM and SIGHUP end a run or a campaign; what goes to stderr never ends a command.

A run is interrupted by an exception from the signal handler. Compiled code may swallow the exception or turn it into
another error, so the signal is stored, and the exception is raised again until the run ends. A campaign is not
interrupted: the handler only stores the signal, and the runner asks for it. A terminal that closes sends SIGHUP; nohup
lets the command ignore it, and so it stays.

Each standard stream may be closed, a full disk or a terminal that is gone. Answers go to stdout, and one that cannot be
written is an error.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Final, final

import click

AGAIN: Final = 2.0
"""Seconds after which the exception is raised again if the run has not ended; cleaning up takes far less."""
Handler = Callable[[int, FrameType | None], None]


@final
class Interrupts:
    """The signal that this process received, 0 if none."""

    def __init__(self) -> None:
        self.number = 0

    @property
    def code(self) -> int:
        """Exit code of a process that the signal ended."""
        return 128 + self.number

    @property
    def reason(self) -> str:
        """Why the process ended."""
        return "interrupted" if self.number == signal.SIGINT else f"stopped by {signal.Signals(self.number).name}"

    @contextlib.contextmanager
    def raising(self) -> Iterator[None]:
        """Raise KeyboardInterrupt at a signal, again and again until the block ends."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        handlers: dict[int, Handler] = dict.fromkeys(_signals(), self._raise)
        handlers[signal.SIGALRM] = self._raise_again
        with _handled(handlers), _swallowed_interrupts_unreported():
            try:
                yield
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)

    @contextlib.contextmanager
    def noted(self) -> Iterator[Callable[[], bool]]:
        """Store the first signal, and raise KeyboardInterrupt at the second; yields whether one arrived."""
        if threading.current_thread() is not threading.main_thread():
            yield lambda: False
            return
        with _handled(dict.fromkeys(_signals(), self._note)):
            yield lambda: self.number != 0

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number

    def _raise(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        raise KeyboardInterrupt

    def _raise_again(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt


def _signals() -> list[signal.Signals]:
    """The signals that end a command: SIGHUP only if the process did not ignore it when it started."""
    hangs_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hangs_up else [])]


@contextlib.contextmanager
def _handled(handlers: dict[int, Handler]) -> Iterator[None]:
    """Install the handlers, and restore the former ones at the end."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _swallowed_interrupts_unreported() -> Iterator[None]:
    """Do not print a KeyboardInterrupt that a callback from compiled code cannot pass on: it is raised again."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda error: None if error.exc_type is KeyboardInterrupt else before(error)
    try:
        yield
    finally:
        sys.unraisablehook = before


ENDED: Final = (OSError, ValueError)
"""What writing to a stream raises that is full, gone or closed."""


def open_streams() -> None:
    """Open the null device for each standard stream that is closed.

    Otherwise the next file to be opened, such as a result, gets the stream's number, and with it what libraries print.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # it gets the lowest free number
        if getattr(sys, name) is None:
            nothing = Path(os.devnull).open("w" if number else "r", encoding="utf-8")  # noqa: SIM115 - it stays open
            setattr(sys, name, nothing)


def tell(text: str) -> None:
    """Print a line on stderr, if that is possible."""
    with contextlib.suppress(*ENDED):
        click.echo(text, err=True)


def end_stderr() -> None:
    """Write what is left on stderr. If that is impossible, the interpreter must not try again and fail at its end."""
    try:
        sys.stderr.flush()
    except ENDED:
        redirect_to_nowhere(2)


def redirect_to_nowhere(number: int) -> None:
    """Redirect a stream to the null device."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)
