"""Plug-ins are announced before they are imported: one line on stderr, unless the command is quiet."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Final

import click

from wsnsim.base.plugin_code import PluginImport, watching_imports
from wsnsim.cli.shared import echo

CAMPAIGNS: Final = ("sweep", "compare", "reproduce")
"""Commands whose runs, in other processes, import plug-ins again and again."""


@contextlib.contextmanager
def plugins_announced() -> Iterator[None]:
    """Print a line for each plug-in before it is imported."""
    said: set[str] = set()

    def announce(plugin: PluginImport) -> None:
        if plugin.kind not in said and not _is_quiet():
            said.add(plugin.kind)
            file = f" ({plugin.file})" if plugin.file else ""
            echo(f"wsnsim: imports {plugin.module}{file}, plug-in of {plugin.role}.kind", err=True)

    with watching_imports(announce):
        yield


def _is_quiet() -> bool:
    context = click.get_current_context(silent=True)
    options = context.params if context else {}
    return (
        (context is not None and context.info_name in CAMPAIGNS)
        or bool(options.get("quiet"))
        or options.get("progress") in ("json", "none")
    )
