"""Commands of wsnsim, run in this process: their exit code and what they print."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from wsnsim.cli import main


class Answer(NamedTuple):
    """The exit code of a command, and what it printed."""

    code: int
    out: str
    err: str


def run_command(capsys: pytest.CaptureFixture[str], *arguments: str) -> Answer:
    """Run a command line."""
    capsys.readouterr()
    code = main(list(arguments))
    printed = capsys.readouterr()
    return Answer(code, printed.out, printed.err)
