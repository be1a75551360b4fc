"""The tables of `wsnsim list`: the kinds of a role, and the shipped scenarios, sweeps and datasheets.

None of the listed kinds is imported.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from wsnsim.scenario import shipped
from wsnsim.scenario.files import sheet_of, shipped_parts, shipped_sweeps
from wsnsim.scenario.registry import ROLES, Kind, Role, kinds, role_named

COLUMNS: Final = ("kind", "idea", "paper")
TRACKER_COLUMNS: Final = ("kind", "paper", "idea", "state", "messages", "variants")


def listed(word: str | None, as_json: bool) -> str | dict[str, Any]:
    """The list that a word names: a role, 'scenarios', 'sweeps' or 'parts'; without a word, every role."""
    if word in ("scenario", "scenarios"):
        # a file without a name is a base that scenarios extend
        named = {n: p for n, p in shipped().items() if re.search(r"^name:", _text(p), re.MULTILINE)}
        return _files("scenarios", ["scenario", "description"], named, as_json)
    if word in ("sweep", "sweeps"):
        return _files("sweeps", ["sweep", "question"], shipped_sweeps(), as_json)
    if word in ("part", "parts"):
        return _datasheets(as_json)
    roles = [role_named(word)] if word else list(ROLES.values())
    if as_json:
        return {"roles": {role.name: _role_json(role) for role in roles}}
    return "\n\n".join(_role_text(role) for role in roles)


def _files(key: str, heads: list[str], files: Mapping[str, Path], as_json: bool) -> str | dict[str, Any]:
    """Files and the first sentence of each."""
    descriptions = {name: _first_sentence(_text(path)) for name, path in files.items()}
    return {key: descriptions} if as_json else table(heads, [list(row) for row in descriptions.items()])


def _datasheets(as_json: bool) -> str | dict[str, Any]:
    """The shipped datasheets, and what each describes."""
    found = {
        name: {"sheet": sheet_of(path), "what": _first_sentence(_text(path))} for name, path in shipped_parts().items()
    }
    if as_json:
        return {"parts": found}
    rows = [[name, row["sheet"], row["what"]] for name, row in found.items()]
    return table(["part", "datasheet of a", "description"], rows)


def _role_json(role: Role) -> dict[str, Any]:
    rows = [dict(vars(row)) for row in kinds(role.name).values()]
    return {"purpose": role.purpose, "default": role.default, "group": role.group, "kinds": rows}


def _role_text(role: Role) -> str:
    columns = TRACKER_COLUMNS if role.name == "tracker" else COLUMNS
    heads = [{"messages": "messages per step"}.get(name, name) for name in columns]
    cells = [[_cell(row, name, role) for name in columns] for row in kinds(role.name).values()]
    return f"{role.plural}: {role.purpose}\n{table(heads, cells)}"


def _cell(row: Kind, name: str, role: Role) -> str:
    text = str(vars(row)[name])
    return f"{text} (default)" if name == "kind" and text == role.default else text


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _first_sentence(text: str) -> str:
    """The first sentence of the comment at the top of a file, without the note for editors and lines in brackets."""
    lines = [
        line.lstrip("# ") for line in text.splitlines() if line.startswith("#") and "yaml-language-server" not in line
    ]
    return " ".join(line for line in lines if not line.startswith("(")).partition(". ")[0]


def table(heads: list[str], rows: Sequence[list[str]]) -> str:
    """A table with aligned columns; on a terminal that is too narrow, a block of lines per row."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    width = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and sum(widths) + 2 * len(widths) > width:
        return "\n".join(_block(heads, row, width) for row in rows)
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in [heads, *rows])
    return "\n".join(f"  {line}".rstrip() for line in lines)


def _block(heads: list[str], row: list[str], width: int) -> str:
    """A row as lines: its first cell, then every other cell behind its head, wrapped."""
    indent = 6 + max(map(len, heads))
    lines = [f"  {row[0]}"]
    for head, cell in zip(heads[1:], row[1:], strict=True):
        start = f"    {head}".ljust(indent)
        lines += textwrap.wrap(cell, max(width - 1, 2 * indent), initial_indent=start, subsequent_indent=" " * indent)
    return "\n".join(lines)
