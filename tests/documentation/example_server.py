"""Runs examples in copies of one process, since importing wsnsim and loading kernels takes longer than most examples.

A copy (`os.fork`) is a process of its own: it has its arguments, working directory, environment and streams, and
nothing that another example has imported or changed. Each command is a copy; the Python blocks of a page share one.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import json
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, NoReturn

ROOT: Final = Path(__file__).parents[2]
SETTINGS: Final = {
    "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]),
    "PYTHONWARNINGS": "error::DeprecationWarning:__main__",
    "MPLBACKEND": "agg",
    "COLUMNS": "120",
}
"""The variables that examples have beside those of the tests."""
SECONDS: Final = 300
"""A command or the blocks of a page that take longer than this are stopped."""
WARM: Final = ("pso_mhpf", "ekf_real", "jiang_field")
"""Scenarios of which a piece is run before the first example."""


class ExampleServer:
    """Client of the server process, which ends with the test process."""

    def __init__(self) -> None:
        read, write = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({write})"],
            cwd=ROOT,
            env=os.environ | SETTINGS,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=[write],
            text=True,
        )
        os.close(write)
        self._replies = os.fdopen(read)
        atexit.register(self._close)

    def command(self, words: list[str], folder: Path, env: dict[str, str]) -> tuple[int, str]:
        """The exit code of `wsnsim …` or `python FILE …`, and what it prints: standard output, then errors."""
        code, printed = self._asked("command", words, str(folder), env)
        return code, printed

    def block(self, code: str, where: str, folder: Path, env: dict[str, str]) -> str:
        """Execute a Python block of a page, and return the traceback if it fails, else nothing."""
        return str(self._asked("block", code, where, str(folder), env))

    def end_page(self) -> None:
        """End the process that has the names of the page's Python blocks."""
        self._asked("end")

    def _asked(self, *request: Any) -> Any:
        assert self._process.stdin is not None
        reply = ""
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            reply = self._replies.readline()
        if not reply:
            raise RuntimeError(f"the example server ended (code {self._process.wait(timeout=SECONDS)})")
        return json.loads(reply)

    def _close(self) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait(timeout=SECONDS)
        self._replies.close()


@functools.cache
def server() -> ExampleServer:
    """The server of this process."""
    return ExampleServer()


def serve(replies: int) -> None:
    """Answer requests, each a line of JSON, until there are no more."""
    _warm_up()
    page = _Page()
    answers: dict[str, Callable[..., Any]] = {"command": _command, "block": page.block, "end": page.end}
    for line in iter(sys.stdin.readline, ""):
        kind, *details = json.loads(line)
        os.write(replies, json.dumps(answers[kind](*details)).encode() + b"\n")


def _warm_up() -> None:
    """Import what commands import, and load the kernels that most of them use."""
    import matplotlib.pyplot  # noqa: F401
    import pandas  # noqa: F401

    import wsnsim
    import wsnsim.cli

    for name in WARM:
        wsnsim.experiment.simulate_run(wsnsim.load(name, ["duration=1 s"]))
    gc.collect()
    gc.freeze()


def _command(words: list[str], folder: str, env: dict[str, str]) -> tuple[int, str]:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        child = os.fork()
        if not child:
            _take_folder_and_streams(folder, env, out.fileno(), errors.fileno())
            _perform(words)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        errors.seek(0)
        return code, (out.read() + errors.read()).decode(errors="replace")


def _take_folder_and_streams(
    folder: str, env: dict[str, str], out: int | None = None, errors: int | None = None
) -> None:
    """Let this copy have its own working directory, environment and streams."""
    signal.alarm(SECONDS)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(env)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing if out is None else out, 1)
    os.dup2(2 if errors is None else errors, 2)


def _perform(words: list[str]) -> NoReturn:
    """End this copy as the process of a command ends."""
    if words[0] == "wsnsim":
        from wsnsim.cli import main

        sys.argv = words
        sys.exit(main())
    sys.argv, sys.path[:0] = words[1:], [str(Path(words[1]).resolve().parent)]
    runpy.run_path(words[1], run_name="__main__")
    sys.exit()


class _Page:
    """The copy that executes the Python blocks of a page, from the first of them to the end of the page."""

    def __init__(self) -> None:
        self._copy: tuple[Connection, int] | None = None

    def block(self, code: str, where: str, folder: str, env: dict[str, str]) -> str:
        if self._copy is None:
            ours, its = multiprocessing.Pipe()
            child = os.fork()
            if not child:
                ours.close()
                _take_folder_and_streams(folder, env)
                _execute_blocks(its)
            its.close()
            self._copy = ours, child
        try:
            self._copy[0].send((code, where))
            return str(self._copy[0].recv())
        except (EOFError, OSError):
            return "the Python process ended"

    def end(self) -> None:
        if self._copy is not None:
            connection, child = self._copy
            with contextlib.suppress(OSError):  # the copy may have ended itself
                connection.send(None)  # what a command has left running holds the connection open
            connection.close()
            os.waitpid(child, 0)
            self._copy = None


def _execute_blocks(connection: Connection) -> NoReturn:
    """Execute blocks one after the other, in one namespace, until the page ends."""
    sys.path.insert(0, "")
    names = {"__name__": "__main__"}
    while True:
        signal.alarm(0)  # the limit is that of a block: commands between blocks have their own
        try:
            request = connection.recv()
        except EOFError:
            request = None
        if request is None:
            sys.exit()
        code, where = request
        signal.alarm(SECONDS)
        try:
            exec(compile(code, where, "exec"), names)
            connection.send("")
        except BaseException:
            connection.send(traceback.format_exc())
