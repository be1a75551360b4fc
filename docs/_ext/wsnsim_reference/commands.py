"""The page of the command line: every command with its arguments, options and exit codes."""

from __future__ import annotations

from collections.abc import Iterator

import click

import wsnsim.cli  # noqa: F401  (registers the commands)
from wsnsim.cli.shared import PURPOSES, every_command, group
from wsnsim_reference.markdown import code, escaped, fence, generated, table

EXIT_CODES = (
    ("0", "success"),
    ("1", "a run failed, or a file cannot be read or written; `diff` and `verify`: there are differences"),
    ("2", "wrong usage, or an invalid scenario"),
    ("3", "a campaign is incomplete"),
    ("129, 130, 141, 143", "ended by SIGHUP, Ctrl-C, a closed pipe, SIGTERM"),
)


def page() -> str:
    """Return the text of the page."""
    commands = every_command()
    rows = [
        ["" if number else purpose, f"[{name}](#{name})", escaped(commands[name].get_short_help_str(100))]
        for purpose, names in PURPOSES.items()
        for number, name in enumerate(names)
    ]
    return generated(
        "Commands",
        escaped(" ".join((group.help or "").split())),
        "Results go to standard output, progress and errors to standard error. `--json` prints one JSON object.",
        table(("", "command", "does"), rows),
        "Exit codes:",
        table(("code", "meaning"), EXIT_CODES),
        *(block for name, one in sorted(every_command().items()) for block in _command(name, one)),
    )


def _command(name: str, command: click.Command) -> Iterator[str]:
    context = click.Context(command, info_name=f"wsnsim {name}")
    yield f"## {name}"
    yield fence("text", " ".join(command.get_usage(context).removeprefix("Usage: ").split()))
    for paragraph in (command.help or "").split("\n\n"):
        yield _paragraph(paragraph)
    if rows := [_row(one, context) for one in command.params if isinstance(one, click.Option) and not one.hidden]:
        yield table(("option", "meaning"), rows)


def _paragraph(text: str) -> str:
    if text.lstrip().startswith("\b"):
        return fence("text", text.replace("\b", "").strip("\n"))
    return escaped(" ".join(text.split()))


def _row(option: click.Option, context: click.Context) -> list[str]:
    record = option.get_help_record(context)
    assert record is not None
    names, text = record
    return [code(names), escaped(" ".join(text.split()))]
