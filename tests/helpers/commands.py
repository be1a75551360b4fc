"""Commands of wsnsim, run in this process or in one of their own: their exit code and what they print."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
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


def run_process(folder: Path, *arguments: str, program: Sequence[str] = ("-m", "wsnsim"), **variables: str) -> Answer:
    """Run a command line as a process in a folder, as a shell does, with some environment variables set."""
    command = [sys.executable, *program, *arguments]
    env = {**os.environ, **variables}
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=env)
    return Answer(ended.returncode, ended.stdout, ended.stderr)
