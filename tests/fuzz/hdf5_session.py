"""Commands on many damaged results, in a process of their own with limits of memory and time, and what they said.

answers(folder, commands) -> [Answer]        a process that dies gives the answer that it did not give

    python -m tests.fuzz.hdf5_session          reads lines [number, words]; writes lines [number, code, stdout, stderr]
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

MEMORY = 6 << 30
"""Bytes of address space. An intact file takes less than half of it; most of that are libraries."""
SECONDS = 60
"""Processor seconds of one command after which it hangs."""


class Answer(NamedTuple):
    """What a command said; the code is that of the process, negative if a signal ended it."""

    words: list[str]
    code: int
    out: str
    err: str

    def fault(self) -> str:
        """What is wrong with the answer; '' if nothing is."""
        if self.code not in (0, 1, 2):
            return f"ended by signal {-self.code}" if self.code < 0 else f"exit code {self.code}"
        for bad in ("internal error", "Traceback", "Warning"):
            if bad in self.err:
                return bad
        if "root:x:0" in self.out + self.err:
            return "shows another file"
        if not all(c.isprintable() or c in "\n\t\xa0" for c in self.out + self.err):
            return "control characters"
        if self.code == 1 and "wsnsim: error: " in self.err and self.err.count("\n") != 1:
            return "more than one line"
        return "" if self.code == 0 or self.err or self.out else "no message"


def answers(commands: Sequence[list[str]], folder: Path) -> list[Answer]:
    """The answers to the commands, given in the folder. After a command that ends its process, another one goes on."""
    found: list[Answer] = []
    while len(found) < len(commands):
        left = commands[len(found) :]
        done = subprocess.run(
            [sys.executable, "-m", "tests.fuzz.hdf5_session"], input=json.dumps(left), text=True, cwd=folder,
            capture_output=True, env=_environment(),
        )  # fmt: skip
        found += [Answer(*json.loads(line)) for line in done.stdout.splitlines()]
        if len(found) < len(commands):
            found.append(Answer(commands[len(found)], done.returncode or -1, "", done.stderr[-300:]))
    return found


def _environment() -> dict[str, str]:
    import os

    root = str(Path(__file__).parents[2])
    return os.environ | {"PYTHONPATH": root, "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"}


def _main() -> None:
    from wsnsim.cli import main

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for words in json.load(sys.stdin):
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # SIGPROF ends the process
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(words)
        print(json.dumps([words, code, out.getvalue(), err.getvalue()]), flush=True)


if __name__ == "__main__":
    _main()
