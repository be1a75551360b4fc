"""The tables of `wsnsim list`: the kinds of a role, and the shipped scenarios, sweeps and datasheets.

None of the listed kinds is imported.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import wsnsim.scenario
from wsnsim.analysis.phrases import width
from wsnsim.base.files import read_sections
from wsnsim.scenario.registry import ROLES, Role, kinds, role_named
from wsnsim.scenario.texts import sheet_of, shipped_parts, shipped_sweeps

COLUMNS: Final = ("kind", "idea", "paper")
SCENARIOS: Final = Path(wsnsim.scenario.__file__).with_name("scenarios.table")
NARROWEST: Final = 12
"""Characters below which no column is wrapped."""


def listed(word: str | None, as_json: bool) -> str | dict[str, Any]:
    """The table for a word: a role, 'scenarios', 'sweeps' or 'datasheets'; without a word, all roles."""
    if word in ("scenario", "scenarios"):
        return _scenarios(as_json)
    if word in ("sweep", "sweeps"):
        questions = {name: _first_sentence(_text(path)) for name, path in shipped_sweeps().items()}
        table = wrapped_table(["sweep", "question"], [*map(list, questions.items())])
        return {"sweeps": questions} if as_json else table
    if word in ("datasheet", "datasheets"):
        return _datasheets(as_json)
    roles = [role_named(word, ("scenarios", "sweeps", "datasheets"))] if word else list(ROLES.values())
    if as_json:
        return {"roles": {role.name: _role_json(role) for role in roles}}
    more = "More on a kind: wsnsim info KIND, such as wsnsim info " + next(iter(kinds(roles[0].name)))
    return "\n\n".join([*(_role_text(role) for role in roles), more])


def _scenarios(as_json: bool) -> str | dict[str, Any]:
    """The shipped scenarios in groups: name, and what each shows."""
    groups = read_sections(SCENARIOS)
    if as_json:
        return {"scenarios": {name: shows for group in groups for name, shows in group.rows}}
    names = max(len(name) for group in groups for name, _ in group.rows)
    tables = ([group.heading[0], *(f"  {name:{names}}  {shows}" for name, shows in group.rows)] for group in groups)
    return "\n\n".join("\n".join(lines) for lines in tables)


def _datasheets(as_json: bool) -> str | dict[str, Any]:
    """The shipped datasheets, and what each describes."""
    found = {
        name: {"sheet": sheet_of(path), "what": _first_sentence(_text(path))} for name, path in shipped_parts().items()
    }
    if as_json:
        return {"datasheets": found}
    rows = [[name, row["sheet"], row["what"]] for name, row in found.items()]
    return wrapped_table(["datasheet", "of a", "description"], rows)


def _role_json(role: Role) -> dict[str, Any]:
    about = {key: getattr(role, key) for key in ("purpose", "default", "group")}
    return about | {"kinds": [row._asdict() for row in kinds(role.name).values()]}


def _role_text(role: Role) -> str:
    cells = [
        [row.kind + " (default)" * (row.kind == role.default), row.idea, row.paper] for row in kinds(role.name).values()
    ]
    return f"{role.plural}: {role.purpose}\n{wrapped_table(list(COLUMNS), cells)}"


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _first_sentence(text: str) -> str:
    """The first sentence of the comment at the top of a file, without the note for editors and lines in brackets."""
    lines = [
        line.lstrip("# ") for line in text.splitlines() if line.startswith("#") and "yaml-language-server" not in line
    ]
    return " ".join(line for line in lines if not line.startswith("(")).partition(". ")[0]


def paragraph(text: str, start: str = "", indent: str | None = None) -> str:
    """A text wrapped to the screen: `start` begins its first line, and `indent` (else `start`) the others."""
    later = start if indent is None else indent
    return textwrap.fill(text, width(), initial_indent=start, subsequent_indent=later, break_on_hyphens=False)


def wrapped_table(headings: list[str], rows: Sequence[list[str]], indent: str = "  ") -> str:
    """A table that fits the screen: cells are wrapped, except those of the first column."""
    widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
    available = width() - len(indent) - 2 * (len(widths) - 1)
    while sum(widths) > available and max(widths[1:]) > NARROWEST:
        widths[max(range(1, len(widths)), key=lambda i: widths[i])] -= 1
    lines = []
    for row in [headings, *rows]:
        sized = zip(row[1:], widths[1:], strict=True)
        cells = [[row[0]], *(textwrap.wrap(cell, size, break_on_hyphens=False) or [""] for cell, size in sized)]
        for pieces in itertools.zip_longest(*cells, fillvalue=""):
            line = "  ".join(piece.ljust(size) for piece, size in zip(pieces, widths, strict=True))
            lines.append(f"{indent}{line}".rstrip())
    return "\n".join(lines)
