"""The command line: what a user types becomes calls, and what went wrong becomes one message and an exit code.

    wsnsim run | check | list | schema | new | info | trace | diff | plot | verify | recover

Only click is imported here; everything else when it is used, so that `wsnsim --help` and `wsnsim list` answer at once.
stdout is the answer, stderr progress and log. Exit codes: 0 ok; 1 a run failed; 2 usage or scenario; 130 Ctrl-C; 141
broken pipe; 143 SIGTERM.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import ScenarioError, WsnsimError
from wsnsim.cli.commands import group

__all__ = ["main"]

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


class _Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a run as Ctrl-C does."""


def _terminate(number: int, frame: Any) -> None:
    raise _Terminated


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code of a command line. No error leaves a traceback, unless WSNSIM_TRACEBACK is set."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # for kinds such as mylab.trackers:Mine, written beside the scenario
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal that has no × still gets its answer
    before = (
        signal.signal(signal.SIGTERM, _terminate) if threading.current_thread() is threading.main_thread() else None
    )
    try:
        return _perform(list(sys.argv[1:] if arguments is None else arguments))
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)


def _perform(arguments: list[str]) -> int:
    try:
        with group.make_context("wsnsim", arguments or ["--help"]) as context:
            code = group.invoke(context)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except click.ClickException as error:
        return _complain(f"{error.format_message()}{_hint(error)}", 2)
    except ScenarioError as error:
        return _complain(str(error), error.exit_code, mark="")
    except WsnsimError as error:
        _trace()
        return _complain(str(error), error.exit_code)
    except _Terminated:
        return _complain("stopped by SIGTERM", 143)
    except (KeyboardInterrupt, click.Abort):
        return _complain("interrupted", 130)
    except BrokenPipeError:
        return _leave_pipe()
    except OSError as error:
        _trace()
        _leave_pipe()
        return _complain(f"cannot go on: {error.strerror or error}{f': {error.filename}' if error.filename else ''}", 1)
    except Exception as error:
        return _internal(error)


def _complain(message: str, code: int, mark: str = "wsnsim: error: ") -> int:
    try:
        click.echo(f"{mark}{message}", err=True)
    except BrokenPipeError:
        return _leave_pipe()
    return code


def _hint(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    return f" (see '{context.command_path} --help')" if context else ""


def _leave_pipe() -> int:
    """Nobody reads on: leave silently, and let the interpreter's last flush go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return 141


def _trace() -> None:
    """The traceback, for those who asked for it."""
    if os.environ.get("WSNSIM_TRACEBACK"):
        import traceback

        traceback.print_exc()


def _internal(error: Exception) -> int:
    _trace()
    said = " ".join(str(error).split())
    hint = "set WSNSIM_TRACEBACK=1 to see where"
    return _complain(f"{type(error).__name__}: {said} ({hint})", 1, mark="wsnsim: internal error: ")
