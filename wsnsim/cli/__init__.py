"""The command line: what a user types becomes calls, and what went wrong becomes one message and an exit code.

    wsnsim run | sweep | compare | collect | reproduce | report | check | list | schema | new | info | export | trace |
           diff | plot | verify | recover

Only click is imported here; everything else when it is used, so that `wsnsim --help` and `wsnsim list` answer at once.
stdout is the answer, stderr progress and log. Exit codes: 0 ok; 1 a run failed; 2 usage or scenario; 3 a
campaign is incomplete; 130 Ctrl-C; 141 broken pipe; 143 SIGTERM.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click

from wsnsim.base.errors import ScenarioError, WsnsimError
from wsnsim.cli import campaigns, commands, plotting, reporting, reproducing
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.shared import group

__all__ = ["campaigns", "commands", "main", "plotting", "reporting", "reproducing"]

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code of a command line. No error leaves a traceback, unless WSNSIM_TRACEBACK is set."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # for kinds such as mylab.trackers:Mine, written beside the scenario
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal that has no × still gets its answer
    interrupts = Interrupts()
    try:
        with interrupts.raising():
            return _perform(list(sys.argv[1:] if arguments is None else arguments), interrupts)
    except KeyboardInterrupt:  # while the answer was on its way
        return interrupts.code


def _perform(arguments: list[str], interrupts: Interrupts) -> int:
    """Run the command. Whatever comes after a signal came is the signal's: compiled code may give it another name."""
    try:
        with group.make_context("wsnsim", arguments or ["--help"], obj=interrupts) as context:
            code = group.invoke(context)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except BaseException as error:
        if interrupts.number:
            return _complain(interrupts.words, interrupts.code)
        return _failed(error)


def _failed(error: BaseException) -> int:
    """The message of what went wrong, and its exit code."""
    try:
        raise error
    except click.ClickException as error:
        return _complain(f"{error.format_message()}{_hint(error)}", 2)
    except ScenarioError as error:
        return _complain(str(error), error.exit_code, mark="")
    except WsnsimError as error:
        _trace()
        return _complain(str(error), error.exit_code)
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
