"""Tables of text that stand beside the code as files: columns, kinds, citations and synonyms."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class Section(NamedTuple):
    """A section of a table: the cells of its heading, and the cells of its rows."""

    heading: tuple[str, ...]
    rows: list[tuple[str, ...]]


def read_sections(path: Path) -> list[Section]:
    """Return the sections of a file.

    A line '= cell | cell' begins a section, any other line is a row 'cell | cell'; '-' is an empty cell. An indented
    line continues the one above it; empty lines and lines that begin with '#' are left out.
    """
    found: list[Section] = []
    for line in path.read_text(encoding="utf-8").replace("\n    ", " ").splitlines():
        if line.startswith("= "):
            found.append(Section(_cells(line[2:]), []))
        elif line and not line.startswith("#"):
            found[-1].rows.append(_cells(line))
    return found


def _cells(line: str) -> tuple[str, ...]:
    return tuple("" if cell == "-" else cell for cell in line.split(" | "))
