"""What `wsnsim list` shows: the kinds of a role, and the shipped scenarios, importing none of them.

roles_text(roles), roles_json(roles), scenarios_text(), scenarios_json()
"""

from __future__ import annotations

import itertools
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, Final

from wsnsim.scenario import shipped
from wsnsim.scenario.catalog import Role, Row, kinds

COLUMNS: Final = ("kind", "idea", "paper")
TRACKER_COLUMNS: Final = ("kind", "paper", "idea", "state", "messages", "variants")
NARROWEST: Final = 12


def roles_text(roles: Sequence[Role]) -> str:
    """A table a role."""
    return "\n\n".join(_role_text(role) for role in roles)


def roles_json(roles: Sequence[Role]) -> dict[str, Any]:
    """The same as plain values."""
    return {"roles": {role.name: _role_json(role) for role in roles}}


def scenarios_text() -> str:
    """A table of the shipped scenarios."""
    return _table(["scenario", "what it is"], [[name, words] for name, words in scenarios_json()["scenarios"].items()])


def scenarios_json() -> dict[str, Any]:
    """The same as plain values. A file that names no scenario is there to be extended."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in shipped().items()}
    named = {name: text for name, text in texts.items() if re.search(r"^name:", text, re.MULTILINE)}
    return {"scenarios": {name: _first_sentence(text) for name, text in named.items()}}


def _role_json(role: Role) -> dict[str, Any]:
    rows = [dict(vars(row)) for row in kinds(role.name).values()]
    return {"purpose": role.purpose, "default": role.default, "group": role.group, "kinds": rows}


def _role_text(role: Role) -> str:
    columns = TRACKER_COLUMNS if role.name == "tracker" else COLUMNS
    heads = [{"messages": "messages per step"}.get(name, name) for name in columns]
    cells = [[_cell(row, name, role) for name in columns] for row in kinds(role.name).values()]
    return f"{role.plural}: {role.purpose}\n{_table(heads, cells)}"


def _cell(row: Row, name: str, role: Role) -> str:
    text = str(getattr(row, name))
    return f"{text} (default)" if name == "kind" and text == role.default else text


def _first_sentence(text: str) -> str:
    """What the comment on top of a scenario says first; a remark in brackets is for editors."""
    lines = [
        line.lstrip("# ") for line in text.splitlines() if line.startswith("#") and "yaml-language-server" not in line
    ]
    spoken = " ".join(line for line in lines if not line.startswith("("))
    return spoken.partition(". ")[0]


def _table(heads: list[str], rows: list[list[str]]) -> str:
    """Aligned columns; on a terminal, cells are wrapped to its width."""
    widths = _widths([heads, *rows])
    lines = []
    for row in [heads, *rows]:
        cells = [textwrap.wrap(cell, width) or [""] for cell, width in zip(row, widths, strict=True)]
        for pieces in itertools.zip_longest(*cells, fillvalue=""):
            padded = (piece.ljust(width) for piece, width in zip(pieces, widths, strict=True))
            lines.append(("  " + "  ".join(padded)).rstrip())
    return "\n".join(lines)


def _widths(rows: list[list[str]]) -> list[int]:
    """What each column needs; on a terminal that is too narrow for it, the widest columns give way."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    room = shutil.get_terminal_size().columns - 2 * len(widths) if sys.stdout.isatty() else sum(widths)
    while sum(widths) > room and max(widths) > NARROWEST:
        widths[widths.index(max(widths))] -= 1
    return [max(width, 1) for width in widths]
