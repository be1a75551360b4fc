"""What `wsnsim list` shows: the kinds of a role, the shipped scenarios, sweeps and datasheets, importing none of them.

listed(word, as_json) -> text or dict
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, Final

from wsnsim.scenario import shipped
from wsnsim.scenario.files import sheet_of, shipped_parts, shipped_sweeps
from wsnsim.scenario.registry import ROLES, Kind, Role, kinds, role_named

COLUMNS: Final = ("kind", "idea", "paper")
TRACKER_COLUMNS: Final = ("kind", "paper", "idea", "state", "messages", "variants")


def listed(word: str | None, as_json: bool) -> str | dict[str, Any]:
    """What a word asks for: the kinds of a role, 'scenarios', 'sweeps', 'parts', or with no word every role."""
    if word in ("scenario", "scenarios"):
        return scenarios_json() if as_json else scenarios_text()
    if word in ("sweep", "sweeps"):
        return sweeps_json() if as_json else sweeps_text()
    if word in ("part", "parts"):
        return parts_json() if as_json else parts_text()
    roles = [role_named(word)] if word else list(ROLES.values())
    return roles_json(roles) if as_json else roles_text(roles)


def roles_text(roles: Sequence[Role]) -> str:
    """A table a role."""
    return "\n\n".join(_role_text(role) for role in roles)


def roles_json(roles: Sequence[Role]) -> dict[str, Any]:
    """The same as plain values."""
    return {"roles": {role.name: _role_json(role) for role in roles}}


def scenarios_text() -> str:
    """A table of the shipped scenarios."""
    return table(["scenario", "what it is"], [[name, words] for name, words in scenarios_json()["scenarios"].items()])


def scenarios_json() -> dict[str, Any]:
    """The same as plain values. A file that names no scenario is there to be extended."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in shipped().items()}
    named = {name: text for name, text in texts.items() if re.search(r"^name:", text, re.MULTILINE)}
    return {"scenarios": {name: _first_sentence(text) for name, text in named.items()}}


def sweeps_text() -> str:
    """A table of the shipped sweeps."""
    return table(["sweep", "what it asks"], [[name, words] for name, words in sweeps_json()["sweeps"].items()])


def sweeps_json() -> dict[str, Any]:
    """The same as plain values."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in shipped_sweeps().items()}
    return {"sweeps": {name: _first_sentence(text) for name, text in texts.items()}}


def parts_text() -> str:
    """A table of the shipped datasheets."""
    rows = [[name, row["sheet"], row["what"]] for name, row in parts_json()["parts"].items()]
    return table(["part", "datasheet of a", "what it is"], rows)


def parts_json() -> dict[str, Any]:
    """The same as plain values."""
    found = shipped_parts().items()
    return {
        "parts": {
            name: {"sheet": sheet_of(path), "what": _first_sentence(path.read_text(encoding="utf-8"))}
            for name, path in found
        }
    }


def _role_json(role: Role) -> dict[str, Any]:
    rows = [dict(vars(row)) for row in kinds(role.name).values()]
    return {"purpose": role.purpose, "default": role.default, "group": role.group, "kinds": rows}


def _role_text(role: Role) -> str:
    columns = TRACKER_COLUMNS if role.name == "tracker" else COLUMNS
    heads = [{"messages": "messages per step"}.get(name, name) for name in columns]
    cells = [[_cell(row, name, role) for name in columns] for row in kinds(role.name).values()]
    return f"{role.plural}: {role.purpose}\n{table(heads, cells)}"


def _cell(row: Kind, name: str, role: Role) -> str:
    text = str(getattr(row, name))
    return f"{text} (default)" if name == "kind" and text == role.default else text


def _first_sentence(text: str) -> str:
    """What the comment on top of a scenario says first; a remark in brackets is for editors."""
    lines = [
        line.lstrip("# ") for line in text.splitlines() if line.startswith("#") and "yaml-language-server" not in line
    ]
    spoken = " ".join(line for line in lines if not line.startswith("("))
    return spoken.partition(". ")[0]


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Aligned columns; on a terminal that is too narrow for them, a block of lines a row."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    room = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and sum(widths) + 2 * len(widths) > room:
        return "\n".join(_block(heads, row, room) for row in rows)
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in [heads, *rows])
    return "\n".join(f"  {line}".rstrip() for line in lines)


def _block(heads: list[str], row: list[str], room: int) -> str:
    """A row as lines: its first cell, then each further one beside its head, wrapped."""
    indent = 6 + max(map(len, heads))
    lines = [f"  {row[0]}"]
    for head, cell in zip(heads[1:], row[1:], strict=True):
        start = f"    {head}".ljust(indent)
        lines += textwrap.wrap(cell, max(room - 1, 2 * indent), initial_indent=start, subsequent_indent=" " * indent)
    return "\n".join(lines)
