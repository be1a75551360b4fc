"""Readers of CSV files, plain or compressed with gzip, whose header names their columns.

read_rows(path, wanted, "readings") -> CsvRows      columns of texts and numbers, bad rows apart
only_rows(path, wanted, "positions") -> CsvRows     the same, where no row may be bad
open_text(path) -> a text file                      for other formats, with the same limits and messages

Rows become arrays while they are read, so that memory is that of the numbers.
"""

from __future__ import annotations

import contextlib
import csv
import gzip
import io
import itertools
import math
import re
import shlex
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeAlias, final

import numpy as np

from wsnsim.base import files
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import MOST_PRINTED, RunError
from wsnsim.base.files import file_digest, why_not_regular

MOST_ROWS: Final = 8_000_000
"""Rows of one file (our choice): readings of 100 nodes, once a second for 22 hours."""
MOST_BAD: Final = 100_000
"""Rows of one file that may be left out because they cannot be used (our choice)."""
LONGEST_LINE: Final = 1_000_000
"""Characters of a line."""
LONGEST_NAME: Final = 200
"""Characters of a text, such as the name of a node (our choice)."""
LONGEST_SHOWN: Final = 60
"""Characters of a cell in a message."""
SKIPPING: Final = "skip_bad_rows: true leaves them out, and the result names them"
"""What helps a scenario whose file has bad rows."""
SkipBadRows: TypeAlias = Annotated[
    bool, "whether rows that cannot be used are left out and counted, instead of refused"
]
IDENTIFIER: Final = re.compile(
    r"(id|name|node|mote|mac|addr|address|receiver|anchor|beacon|station|tag|vehicle|person|label)$", re.IGNORECASE
)
"""Names of columns that look like identifiers (our choice)."""
LOOKED_AT: Final = 20_000
"""Rows in which columns that are not read are looked at (our choice)."""
DATED: Final = re.compile(r"must be a finite number, is '\d{4}-\d\d-\d\d")
"""What is said of a cell that holds a date."""
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


class TextColumn(NamedTuple):
    """(n,) texts, each of which is kept once: `names[codes[i]]` is that of row i. Names are in the file's order."""

    names: tuple[str, ...]
    codes: Ints


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
    texts: Mapping[str, TextColumn]
    numbers: Mapping[str, Floats]
    bad: tuple[BadRow, ...]


def read_rows(path: str, wanted: Wanted, what: str) -> CsvRows:
    """The wanted columns of every non-empty line; rows in which a cell is missing or not a finite number are apart.

    Raises:
        RunError: the file cannot be read, lacks a column, has no row, or more than `MOST_ROWS` rows or `MOST_BAD` bad
            ones.
    """
    bad: list[BadRow] = []
    with open_text(path) as file:
        rows = csv.reader(file)
        texts, numbers = _present(path, rows, wanted)
        codes: list[dict[str, int]] = [{} for _ in texts]
        columns = [("line", np.int64), *((name, np.int64) for name in texts), *((name, np.float64) for name in numbers)]
        table = np.fromiter(_good_rows(path, rows, texts, numbers, codes, bad), dtype=columns)
    if not table.size and not bad:
        raise RunError(f"{path}: contains no {what}")
    column = {name: np.ascontiguousarray(table[name]) for name, _ in columns}
    named = {name: TextColumn(tuple(known), column[name]) for name, known in zip(texts, codes, strict=True)}
    return CsvRows(path, column["line"], named, {name: column[name] for name in numbers}, tuple(bad))


def only_rows(path: str, wanted: Wanted, what: str) -> CsvRows:
    """As `read_rows`, for files in which a row left out would shift the others.

    Raises:
        RunError: as there, or a row cannot be used. The message names file and line.
    """
    rows = read_rows(path, wanted, what)
    if rows.bad:
        raise RunError(f"{path}:{rows.bad[0].line}: {rows.bad[0].reason}")
    return rows


def identifiers(path: str, read: Collection[str]) -> dict[str, list[str]]:
    """The cells, in the first `LOOKED_AT` rows, of the columns that are not `read` and look like identifiers.

    Their names say so (`IDENTIFIER`), and their cells are words or whole numbers.

    Raises:
        RunError: the file cannot be read.
    """
    with open_text(path) as file:
        rows = itertools.islice(filter(any, csv.reader(file)), LOOKED_AT)
        columns = [[cell.strip() for cell in column] for column in itertools.zip_longest(*rows, fillvalue="")]
    return {
        name: cells
        for name, *cells in columns
        if name not in read
        and IDENTIFIER.search(name)
        and all(cell and not number_in(cell) % 1.0 > 0.0 for cell in cells)
    }


def demand_once(place: str, header: Sequence[str], names: Iterable[str]) -> None:
    """Refuse a header that has a column of one of these names twice. Raises RunError with its place."""
    for name in names:
        if header.count(name) > 1:
            raise RunError(f"{place}: the header names the column '{name}' twice: rename one of them, or delete it")


def first_of_equal(among: Bools, *keys: Floats | Ints) -> Ints:
    """(n,) the index of the first row with the same keys (n,), of those `among` which it is sought; else its own."""
    first = np.arange(len(among))
    rows = np.flatnonzero(among)
    order = rows[np.lexsort([key[rows] for key in keys])]  # stable: the first of equal rows comes first
    starts = np.ones(len(order), dtype=np.bool_)
    starts[1:] = np.any([key[order[1:]] != key[order[:-1]] for key in keys], axis=0)
    first[order] = order[np.maximum.accumulate(np.where(starts, np.arange(len(order)), 0))]
    return first


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
            yield _LimitedText(content, encoding="utf-8-sig", newline="")
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
    if all(DATED.search(row.reason) for row in bad):
        like = f" ({len(bad) - 1:,} more rows like it)" if len(bad) > 1 else ""
        dates = f"times are seconds; write: wsnsim import readings (or track) {shlex.quote(path)}, which reads dates"
        return f"{path}:{bad[0].line}: {bad[0].reason}{like}: {dates}"
    listed = row_texts(path, bad[:MOST_PRINTED])
    more = len(bad) - len(listed)
    rest = [words for words in (f"and {more} more" if more else "", remedy) if words]
    return "\n  ".join([f"{path}: {len(bad)} of {rows} rows cannot be used:", *listed, *rest])


def limited(path: str, bad: Iterable[BadRow]) -> list[BadRow]:
    """The bad rows of a file, ascending. Raises RunError where there are more than `MOST_BAD`."""
    rows = sorted(itertools.islice(bad, MOST_BAD + 1), key=lambda row: row.line)
    if len(rows) > MOST_BAD:
        listed = row_texts(path, rows[:MOST_PRINTED])
        raise RunError("\n  ".join([f"{path}: more than {MOST_BAD:,} rows cannot be used:", *listed, "and more"]))
    return rows


def row_texts(path: str, bad: Sequence[BadRow]) -> list[str]:
    """Bad rows, a text each with file, line and reason, without the file's folder."""
    return [f"{Path(path).name}:{row.line}: {row.reason}" for row in bad]


def _decompressed(path: str, file: Any) -> Any:
    """The file, or its content if it is compressed; its first two bytes say which."""
    compressed = file.read(len(files.MAGIC)) == files.MAGIC
    file.seek(0)
    if compressed:
        return files.decompressed(file)
    if path.endswith(".gz"):
        raise RunError(f"{path}: cannot be read: it is not gzip data, though its name ends in .gz")
    return file


@final
class _LimitedText(io.TextIOWrapper):
    """A text whose lines have a greatest length, so that none takes all memory."""

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override]
        """The next line. Raises OSError if it has more than `LONGEST_LINE` characters."""
        line = super().readline(LONGEST_LINE + 1)
        if len(line) > LONGEST_LINE:
            raise OSError(f"a line has more than {LONGEST_LINE:,} characters")
        return line


def _good_rows(
    path: str,
    rows: Any,
    texts: Mapping[str, int],
    numbers: Mapping[str, tuple[int, str]],
    codes: Sequence[dict[str, int]],
    bad: list[BadRow],
) -> Iterator[tuple[float, ...]]:
    """Yield line, codes of the texts and numbers of each row that can be used; add to `codes` and `bad`."""
    count = 0
    for row in rows:
        if not any(map(str.strip, row)):
            continue
        count += 1
        if count > MOST_ROWS:
            raise RunError(f"{path}:{rows.line_num}: has more than {MOST_ROWS:,} rows: split it, or thin it out")
        read = _cells(row, texts, numbers)
        if isinstance(read, str):
            bad.append(BadRow(rows.line_num, read))
            if len(bad) > MOST_BAD:
                limited(path, bad)
        else:
            words = [known.setdefault(word, len(known)) for known, word in zip(codes, read[0], strict=True)]
            yield rows.line_num, *words, *read[1]


def _present(path: str, rows: Any, wanted: Wanted) -> tuple[dict[str, int], dict[str, tuple[int, str]]]:
    """The index of each column of texts, and the index and name of each column of numbers, that the file has."""
    header = [name.strip() for name in next(rows, [])]
    named = {**wanted.texts, **wanted.numbers}
    needed = tuple(theirs for ours, theirs in named.items() if ours not in wanted.optional)
    if not set(needed) <= set(header):
        raise _without_columns(path, header, needed)
    demand_once(f"{path}:1", header, named.values())
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
    if long := [name for name, word in zip(texts, words, strict=True) if len(word) > LONGEST_NAME]:
        return f"{_listed(long)} must have at most {LONGEST_NAME} characters"
    values = []
    for i, name in numbers.values():
        cell = row[i] if i < len(row) else ""
        value = number_in(cell)
        if not math.isfinite(value):
            return f"{name} must be a finite number, is {cell.strip()[:LONGEST_SHOWN]!r}"
        values.append(value)
    return words, values


def number_in(cell: str) -> float:
    """The number that a cell holds; NaN if it holds none."""
    try:
        return float(cell.replace("_", "no digit"))
    except ValueError:
        return math.nan


def _listed(words: Any) -> str:
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else str(last)
