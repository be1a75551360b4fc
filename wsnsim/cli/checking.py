"""Checking a scenario. Plug-ins that it names are imported in a process of their own, which may exit or hang.

check(("x.yaml", (), False), 20.0) -> CheckAnswer
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from multiprocessing.connection import Connection
from typing import Final, NamedTuple

from wsnsim.base.errors import ScenarioError, WsnsimError
from wsnsim.base.plugin_code import TRACEBACK_HINT, PluginImport, announce, plugin_fault, watching_imports
from wsnsim.cli.shared import loaded

START_TIME: Final = 120.0
"""Seconds that the process may take before it imports the first plug-in."""
FAILED: Final = 1
INVALID: Final = 2


Request = tuple[str, tuple[str, ...], bool]
"""What to check: a scenario or a result, overrides, and whether a result may name any plug-in."""


class CheckAnswer(NamedTuple):
    """The exit code, the errors, and the lines to print."""

    code: int
    errors: list[str]
    lines: list[str]


class _PluginNamed(BaseException):  # an Exception would be reported as one of the scenario
    """A scenario names a plug-in, which must not be imported here."""


def check(request: Request, limit: float) -> CheckAnswer:
    """Check a scenario; its plug-ins, if it names any, have `limit` seconds.

    Raises:
        WsnsimError: the source cannot be read.
    """

    def leave(plugin: PluginImport) -> None:
        raise _PluginNamed

    try:
        with watching_imports(leave):
            return _checked(request)
    except _PluginNamed:
        return _checked_apart(request, limit)


def _checked(request: Request) -> CheckAnswer:
    import wsnsim.scenario as scenario
    from wsnsim.analysis import notes, recording_notes

    try:
        setup = scenario.build(loaded(*request))
    except ScenarioError as error:
        return CheckAnswer(INVALID, [str(error)], [])
    stated = [f"  {said}" for said in recording_notes.residuals(setup)]
    return CheckAnswer(0, [], [f"{request[0]}: ok", *stated, *(f"  note: {note}" for note in notes.of_setup(setup))])


def _checked_apart(request: Request, limit: float) -> CheckAnswer:
    """Check a scenario in another process, and kill it after the limit."""
    context = multiprocessing.get_context("spawn")
    ours, its = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(its, request), daemon=True)
    process.start()
    its.close()
    last: PluginImport | None = None
    try:
        while ours.poll(START_TIME if last is None else limit):
            message = ours.recv()
            if isinstance(message, CheckAnswer):
                return message
            last = message
            announce(message)
        reason = f"gave no answer within {limit:g} s (--timeout)"
    except EOFError:
        process.join()
        reason = f"ended the process that checked it (exit code {process.exitcode})"
    finally:
        process.kill()
        process.join()
        ours.close()
    who = f"plug-in {last.kind}" if last else "the check"
    return CheckAnswer(INVALID, [f"{request[0]}: error: {who} {reason}"], [])


def _answer(connection: Connection, request: Request) -> None:
    """Check a scenario in this process, and send the plug-ins that are imported and the answer."""
    with contextlib.suppress(OSError):
        os.dup2(2, 1)  # what a plug-in prints is no answer
    sent: set[str] = set()

    def send_first(plugin: PluginImport) -> None:
        if plugin.kind not in sent:
            sent.add(plugin.kind)
            connection.send(plugin)

    with watching_imports(send_first):
        try:
            found = _checked(request)
        except WsnsimError as error:
            found = CheckAnswer(error.exit_code, [f"wsnsim: error: {error}"], [])
        except Exception as error:
            fault = plugin_fault(error)
            if not fault or os.environ.get("WSNSIM_TRACEBACK"):
                raise
            found = CheckAnswer(FAILED, [f"{request[0]}: error: {fault} ({TRACEBACK_HINT})"], [])
    connection.send(found)
