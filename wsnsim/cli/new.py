"""`wsnsim new`: write a scenario to start from, or a plug-in with a scenario that uses it."""

from __future__ import annotations

import importlib.util
import keyword
from pathlib import Path
from typing import Final

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.shared import echo, group

PLUGIN_ROLES: Final = ("tracker", "sensor", "motion", "mac")
"""The roles for which there is a plug-in to start from."""


@group.command()
@click.argument("name")
@click.option("--bench", is_flag=True, help="Write a scenario of a standalone filter, without a network.")
@click.option("--for", "role", type=click.Choice(PLUGIN_ROLES), help="Also write a plug-in of this role, NAME.py.")
def new(name: str, bench: bool, role: str | None) -> None:
    """Write a commented scenario, and a plug-in with --for.

    Both are starting points. The scenario is NAME.yaml; the plug-in is NAME.py, and the scenario uses it.
    """
    from wsnsim.scenario.examples import template
    from wsnsim.scenario.schema import unsafe_name

    stem = name.removesuffix(".yaml").removesuffix(".py" if role else ".yaml")
    if reason := unsafe_name(stem, "a file"):
        raise UsageError(f"'{name}' {reason}")
    if role is None:
        _write({Path(f"{stem}.yaml"): template(stem, bench)})
        echo(f"{stem}.yaml: written; run it with: wsnsim run {stem}.yaml")
        return
    if bench:
        raise UsageError("--bench cannot be combined with --for")
    if reason := _no_module(stem):
        raise UsageError(f"'{stem}' {reason}")
    module, scenario = (_starter(role, suffix, stem) for suffix in ("py", "yaml"))
    _write({Path(f"{stem}.py"): module, Path(f"{stem}.yaml"): scenario})
    echo(f"{stem}.py and {stem}.yaml: written")
    echo(f"check its rules:  python {stem}.py")
    echo(f"run it:           wsnsim run {stem}.yaml")


def _no_module(name: str) -> str:
    """Return why a name cannot be that of a plug-in's module; '' if it can."""
    if not name.isidentifier() or keyword.iskeyword(name):
        return "cannot name a module of Python: use letters, digits and '_'"
    if Path(f"{name}.py").exists():
        return ""  # which is reported when the file is written
    if importlib.util.find_spec(name) is not None:
        return "is the name of an installed module, which Python would import instead: choose another name"
    return ""


def _starter(role: str, suffix: str, name: str) -> str:
    """Return the text of a plug-in's module ('py') or scenario ('yaml'), with the names that the user chose."""
    source = Path(__file__).parent / "starters" / f"{role}.{suffix}"
    text = source.read_text(encoding="utf-8")
    return text.replace(f"Plugin{role.capitalize()}", class_name(name)).replace("plugin_name", name)


def class_name(name: str) -> str:
    """Return the name of a plug-in's class: 'NearestNode' for 'nearest_node'."""
    found = "".join(piece[:1].upper() + piece[1:] for piece in name.split("_"))
    return found if found.isidentifier() else f"Plugin{found}"


def _write(texts: dict[Path, str]) -> None:
    """Write files that do not exist; none of them if one cannot be written."""
    for path in texts:
        if path.exists() or path.is_symlink():
            raise UsageError(f"file exists: {path}")
    written: list[Path] = []
    try:
        for path, text in texts.items():
            with path.open("x", encoding="utf-8") as file:
                written.append(path)
                file.write(text)
    except OSError as error:
        for path in written:
            path.unlink(missing_ok=True)
        what = (
            f"file exists: {path}" if isinstance(error, FileExistsError) else f"cannot write {path}: {error.strerror}"
        )
        raise UsageError(what) from None
