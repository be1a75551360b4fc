"""Readers of CSV files, plain or compressed with gzip, whose header names their columns.

read_columns(path, ("x", "y"), "positions") -> [(place, (x, y)), ...]      place: 'file:line', for messages
read_rows(path, wanted, "readings") -> CsvRows                              columns of texts and numbers, bad rows apart
open_text(path) -> a text file                                              for other formats, with the same messages
"""

from __future__ import annotations

import contextlib
import csv
import gzip
import io
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base import gzip_content
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import MOST_PRINTED, RunError
from wsnsim.base.regular_files import file_digest, why_not_regular

Row = tuple[str, tuple[float, ...]]

SKIPPING: Final = "skip_bad_rows: true leaves them out, and the result names them"
"""What helps a scenario whose file has bad rows."""
DELIMITERS: Final = {";": "semicolons", "\t": "tabs", "|": "vertical bars"}


@dataclass(frozen=True, slots=True)
class BadRow:
    """A row of a file that cannot be used: its line, and what is wrong and allowed."""

    line: int
    reason: str


@dataclass(frozen=True, slots=True)
class Wanted:
    """The columns that are read: {our name: name in the file's header}.

    Attributes:
        texts: columns of texts, which are stripped and must not be empty.
        numbers: columns of finite numbers.
        optional: our names of the columns that a file may lack.
    """

    texts: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, str] = field(default_factory=dict)
    optional: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class CsvRows:
    """The rows of a file, by our names of the columns, in the file's order.

    Attributes:
        path: the file.
        lines: (n,) line of each good row.
        texts: (n,) texts of each column that the file has.
        numbers: (n,) numbers of each column that the file has.
        bad: the other rows, ascending.
    """

    path: str
    lines: Ints
    texts: Mapping[str, list[str]]
    numbers: Mapping[str, Floats]
    bad: tuple[BadRow, ...]


def read_columns(path: str, names: tuple[str, ...], what: str) -> list[Row]:
    """The named columns of every non-empty line, in the file's order; other columns are ignored.

    Raises:
        RunError: the file cannot be read, lacks a column or is empty, or a cell is not a number. The message names
            file and line.
    """
    with open_text(path) as file:
        found = list(_rows(path, csv.reader(file), names))
    if not found:
        raise RunError(f"{path}: contains no {what}")
    return found


def read_rows(path: str, wanted: Wanted, what: str) -> CsvRows:
    """The wanted columns of every non-empty line; rows in which a cell is missing or not a finite number are apart.

    Raises:
        RunError: the file cannot be read, lacks a column, or has no row.
    """
    good: list[tuple[int, list[str], list[float]]] = []
    bad: list[BadRow] = []
    with open_text(path) as file:
        rows = csv.reader(file)
        texts, numbers = _present(path, rows, wanted)
        for row in rows:
            if any(cell.strip() for cell in row):
                read = _cells(row, texts, numbers)
                if isinstance(read, str):
                    bad.append(BadRow(rows.line_num, read))
                else:
                    good.append((rows.line_num, *read))
    if not good and not bad:
        raise RunError(f"{path}: contains no {what}")
    return CsvRows(
        path,
        np.array([line for line, *_ in good], dtype=np.int64),
        {name: [words[i] for _, words, _ in good] for i, name in enumerate(texts)},
        {name: np.array([values[i] for *_, values in good], dtype=np.float64) for i, name in enumerate(numbers)},
        tuple(bad),
    )


@contextlib.contextmanager
def open_text(path: str) -> Iterator[Any]:
    """Open a UTF-8 text that may be compressed with gzip; what cannot be read within the block is a RunError too.

    Raises:
        RunError: the file cannot be read, is no text, is empty, or is not the gzip data that its name promises.
    """
    if irregular := why_not_regular(path):
        raise RunError(f"{path}: cannot be read: {irregular}")
    try:
        with Path(path).open("rb") as file, _decompressed(path, file) as content:
            yield io.TextIOWrapper(content, encoding="utf-8-sig", newline="")
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RunError(f"{path}: cannot be read: its gzip data is damaged or cut off ({error})") from error
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, csv.Error) as error:
        raise RunError(f"{path}: cannot be read: not a CSV text ({error})") from error


def demand_digest(path: str, digest: str) -> None:
    """Refuse a file that has changed since the scenario was made.

    Args:
        path: The file.
        digest: What the digest of its content was then; '' stands for any.

    Raises:
        RunError: The file is gone, or has another digest.
    """
    if not digest:
        return
    try:
        found = file_digest(path)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}; the scenario was made with this file") from error
    if found != digest:
        raise RunError(f"{path}: the file has changed: its digest is {found}, the scenario was made with {digest}")


def bad_rows_text(path: str, bad: Sequence[BadRow], rows: int, remedy: str = "") -> str:
    """A message that names the first bad rows of a file with their lines, of `rows` in all, and what helps."""
    listed = row_texts(path, bad[:MOST_PRINTED])
    more = len(bad) - len(listed)
    rest = [words for words in (f"and {more} more" if more else "", remedy) if words]
    return "\n  ".join([f"{path}: {len(bad)} of {rows} rows cannot be used:", *listed, *rest])


def row_texts(path: str, bad: Sequence[BadRow]) -> list[str]:
    """Bad rows, a text each with file, line and reason, without the file's folder."""
    return [f"{Path(path).name}:{row.line}: {row.reason}" for row in bad]


def _decompressed(path: str, file: Any) -> Any:
    """The file, or its content if it is compressed; its first two bytes say which."""
    compressed = file.read(len(gzip_content.MAGIC)) == gzip_content.MAGIC
    file.seek(0)
    if compressed:
        return gzip_content.decompressed(file)
    if path.endswith(".gz"):
        raise RunError(f"{path}: cannot be read: it is not gzip data, though its name ends in .gz")
    return file


def _rows(path: str, rows: Any, names: tuple[str, ...]) -> Iterator[Row]:
    header = _header(rows)
    if not set(names) <= set(header):
        raise _without_columns(path, header, names)
    for row in rows:
        if any(cell.strip() for cell in row):
            place = f"{path}:{rows.line_num}"
            yield place, _numbers(place, dict(zip(header, row, strict=False)), names)


def _header(rows: Any) -> list[str]:
    return [name.strip() for name in next(rows, [])]


def _present(path: str, rows: Any, wanted: Wanted) -> tuple[dict[str, int], dict[str, tuple[int, str]]]:
    """The index of each column of texts, and the index and name of each column of numbers, that the file has."""
    header = _header(rows)
    named = {**wanted.texts, **wanted.numbers}
    needed = tuple(theirs for ours, theirs in named.items() if ours not in wanted.optional)
    if not set(needed) <= set(header):
        raise _without_columns(path, header, needed)
    texts = {ours: header.index(theirs) for ours, theirs in wanted.texts.items() if theirs in header}
    numbers = {ours: (header.index(theirs), theirs) for ours, theirs in wanted.numbers.items() if theirs in header}
    return texts, numbers


def _without_columns(path: str, header: list[str], names: Sequence[str]) -> RunError:
    """The error of a header that lacks columns: what it has, and which delimiter it seems to use."""
    words = f"{path}:1: the header must name the columns {_listed(names)}, for example '{','.join(names)}'"
    joined = ",".join(header)
    used = next((word for sign, word in DELIMITERS.items() if sign in joined), "")
    hint = f"; it seems to use {used}, only commas are allowed" if used else ""
    return RunError(words + (f", is '{joined[:200]}'{hint}" if joined else ", the file is empty"))


def _cells(
    row: list[str], texts: Mapping[str, int], numbers: Mapping[str, tuple[int, str]]
) -> tuple[list[str], list[float]] | str:
    """The texts and numbers of a row, or why it cannot be used."""
    words = [row[i].strip() if i < len(row) else "" for i in texts.values()]
    if not all(words):
        return f"{_listed([name for name, word in zip(texts, words, strict=True) if not word])} must not be empty"
    values = []
    for i, name in numbers.values():
        cell = row[i] if i < len(row) else ""
        value = _number(cell)
        if not math.isfinite(value):
            return f"{name} must be a finite number, is {cell.strip()!r}"
        values.append(value)
    return words, values


def _number(cell: str) -> float:
    """The number that a cell holds; NaN if it holds none."""
    try:
        return float(cell.replace("_", "no digit"))
    except ValueError:
        return math.nan


def _numbers(place: str, row: dict[str, str], names: tuple[str, ...]) -> tuple[float, ...]:
    try:
        return tuple(float(row.get(name, "").replace("_", "no digit")) for name in names)
    except ValueError:
        got = _listed([repr(row.get(name, "")) for name in names])
        raise RunError(f"{place}: {_listed(names)} must be numbers, got {got}") from None


def _listed(words: Any) -> str:
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else str(last)
