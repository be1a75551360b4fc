"""The command line: arguments become calls, and errors become one message and an exit code.

    wsnsim run | watch | lifetime | sweep | compare | collect | reproduce | report | check | fit | list | schema | new |
           info | export | import | trace | diff | plot | verify | recover

Only click is imported here. A command is imported when it is asked for, and imports what it needs, so that
`wsnsim --help` and `wsnsim list` answer at once. Results go to stdout, progress and errors to stderr. Exit codes: 0
success; 1 a run failed; 2 wrong usage or scenario; 3 a campaign is incomplete; 129 SIGHUP; 130 Ctrl-C; 141 broken pipe;
143 SIGTERM.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Final

import click

from wsnsim.base.errors import ScenarioError, WsnsimError
from wsnsim.base.files import CacheWarning, prepare_matplotlib
from wsnsim.base.plugin_code import TRACEBACK_HINT, PluginImport, plugin_fault, watching_imports
from wsnsim.base.process import NEW_OBJECTS
from wsnsim.base.runs import watching
from wsnsim.cli.interrupts import Interrupts, end_stderr, open_streams, redirect_to_nowhere
from wsnsim.cli.progress import WorkBar
from wsnsim.cli.shared import echo, group

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
CAMPAIGNS: Final = ("lifetime", "sweep", "compare", "reproduce")
"""Commands whose runs, in other processes, import plug-ins again and again."""
NUMBERS: Final = {"a valid integer range": "a whole number", "a valid float range": "a number", "valid float": "number"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code. An error prints a traceback only if WSNSIM_TRACEBACK is set."""
    gc.set_threshold(NEW_OBJECTS, *gc.get_threshold()[1:])
    open_streams()
    prepare_matplotlib()
    for name in THREADS:
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # for terminals whose encoding lacks ×
    interrupts = Interrupts()
    try:
        with interrupts.raising(), _notes_on_caches():
            return _perform(list(sys.argv[1:] if arguments is None else arguments), interrupts)
    except KeyboardInterrupt:  # while results were printed
        return interrupts.code
    finally:
        end_stderr()


@contextlib.contextmanager
def _notes_on_caches() -> Iterator[None]:
    """Print where kernels are kept as a note, if it is not the usual place and notes are wanted."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if not issubclass(category, CacheWarning):
            before(message, category, *where, **more)
        elif not _is_quiet():
            echo(f"wsnsim: {message}", err=True)

    with warnings.catch_warnings():
        before, warnings.showwarning = warnings.showwarning, show
        yield


@contextlib.contextmanager
def _plugins_announced() -> Iterator[None]:
    """Print a line for each plug-in before it is imported, unless the command is quiet."""
    said: set[str] = set()

    def announce(plugin: PluginImport) -> None:
        if plugin.kind not in said and not _is_quiet(CAMPAIGNS):
            said.add(plugin.kind)
            file = f" ({plugin.file})" if plugin.file else ""
            echo(f"wsnsim: imports {plugin.module}{file}, plug-in of {plugin.role}.kind", err=True)

    with watching_imports(announce):
        yield


def _is_quiet(quiet: Sequence[str] = ()) -> bool:
    """Whether notes are unwanted: by an option of the command, or because it is one of the `quiet`."""
    context = click.get_current_context(silent=True)
    if context is None:
        return False
    options = context.params
    return context.info_name in quiet or bool(options.get("quiet")) or options.get("progress") in ("json", "none")


def _perform(arguments: list[str], interrupts: Interrupts) -> int:
    """Run the command. After a signal every error is reported as the signal: compiled code may raise another one."""
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    try:
        shown = group.make_context("wsnsim", arguments or ["--help"], obj=interrupts)
        with shown as context, contextlib.closing(WorkBar()) as bar, watching(bar.step), _plugins_announced():
            code = group.invoke(context)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as end:
        return end.exit_code
    except BaseException as error:
        if interrupts.number:
            return _print_error(interrupts.reason, interrupts.code)
        return _report(error)


def _report(raised: BaseException) -> int:
    """Print the message of an error and return the exit code."""
    try:
        raise raised
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        hint = f" (see '{context.command_path} --help')" if context else ""
        return _print_error(f"{_said_by_click(error)}{hint}", 2)
    except ScenarioError as error:
        return _print_error(str(error), error.exit_code, prefix="")
    except WsnsimError as error:
        _print_traceback()
        hint = f" ({TRACEBACK_HINT})" if plugin_fault(error) else ""
        return _print_error(f"{error}{hint}", error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        return _print_error("interrupted", 130)
    except BrokenPipeError:
        redirect_to_nowhere(1)  # so that the interpreter's last flush does not fail
        return 141
    except OSError as error:
        _print_traceback()
        redirect_to_nowhere(1)
        return _print_error(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}", 1)
    except (Exception, SystemExit) as error:
        return _report_unexpected(error)


def _said_by_click(error: click.ClickException) -> str:
    """The message of a wrong option or argument, in plain words."""
    said = error.format_message()
    if isinstance(error, click.NoSuchOption) and error.ctx and not error.possibilities:
        options = [name for each in error.ctx.command.params for name in each.opts]
        near = [name for name in options if name.startswith(f"-{error.option_name}")]
        said += f" Long options have two dashes: {', '.join(near)}." if near else ""
    for theirs, ours in NUMBERS.items():
        said = said.replace(theirs, ours)
    return said


def _report_unexpected(error: BaseException) -> int:
    """Print an error of a plug-in's code, or of ours, and return the exit code."""
    fault = plugin_fault(error)
    if isinstance(error, SystemExit) and not fault:
        raise error
    _print_traceback()
    if fault:
        return _print_error(f"{fault} ({TRACEBACK_HINT})", 1)
    message = " ".join(str(error).split())
    return _print_error(f"{type(error).__name__}: {message} ({TRACEBACK_HINT})", 1, "wsnsim: internal error: ")


def _print_error(message: str, code: int, prefix: str = "wsnsim: error: ") -> int:
    echo(f"{prefix}{message}", err=True)
    return code


def _print_traceback() -> None:
    """Print the traceback if WSNSIM_TRACEBACK is set."""
    if os.environ.get("WSNSIM_TRACEBACK"):
        import traceback

        traceback.print_exc()
