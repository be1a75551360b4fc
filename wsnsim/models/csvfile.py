"""Reader of numbers from a CSV file whose header names its columns.

read_columns(path, ("x", "y"), "positions") -> [(place, (x, y)), ...]      place: 'file:line', for messages
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wsnsim.base.errors import RunError
from wsnsim.base.regular_files import why_not_regular

Row = tuple[str, tuple[float, ...]]


def read_columns(path: str, names: tuple[str, ...], what: str) -> list[Row]:
    """The named columns of every non-empty line, in the file's order; other columns are ignored.

    Raises:
        RunError: the file cannot be read, lacks a column or is empty, or a cell is not a number. The message names
            file and line.
    """
    if irregular := why_not_regular(path):
        raise RunError(f"{path}: cannot be read: {irregular}")
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            found = list(_rows(path, csv.reader(file), names))
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else f"not a CSV text ({error})"
        raise RunError(f"{path}: cannot be read: {reason}") from error
    if not found:
        raise RunError(f"{path}: contains no {what}")
    return found


def _rows(path: str, rows: Any, names: tuple[str, ...]) -> Iterator[Row]:
    header = [name.strip() for name in next(rows, [])]
    if not set(names) <= set(header):
        columns = _listed(names)
        raise RunError(f"{path}:1: the header must name the columns {columns}, for example '{','.join(names)}'")
    for row in rows:
        if any(cell.strip() for cell in row):
            place = f"{path}:{rows.line_num}"
            yield place, _numbers(place, dict(zip(header, row, strict=False)), names)


def _numbers(place: str, row: dict[str, str], names: tuple[str, ...]) -> tuple[float, ...]:
    try:
        return tuple(float(row.get(name, "").replace("_", "no digit")) for name in names)
    except ValueError:
        got = _listed([repr(row.get(name, "")) for name in names])
        raise RunError(f"{place}: {_listed(names)} must be numbers, got {got}") from None


def _listed(words: Any) -> str:
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else str(last)
