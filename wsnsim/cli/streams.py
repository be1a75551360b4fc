"""The standard streams, of which each may be closed, a full disk or a terminal that is gone.

Answers go to stdout, and one that cannot be written is an error. What goes to stderr never ends a command.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import Final

import click

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
