"""The reader of CSV files, plain or compressed with gzip, whose header names their columns; pandas parses them.

read_rows(path, wanted, "readings") -> CsvRows      columns of texts and numbers, bad rows apart
only_rows(path, wanted, "positions") -> CsvRows     the same, where no row may be bad
read_cells(path, file, wanted, "links") -> TextCells    for formats with checks of their own
open_text(path) -> a text file                      for other formats, with the same limits and messages

Rows become arrays while they are read, so that memory is that of the numbers.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import functools
import gzip
import io
import itertools
import math
import re
import shlex
import zlib
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, final

import numpy as np

from wsnsim.base import files
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import RunError
from wsnsim.base.files import file_digest, why_not_regular
from wsnsim.models import row_checks
from wsnsim.models.row_checks import CsvRows, TextColumn

MOST_ROWS: Final = 8_000_000
"""Rows of one file (our choice): readings of 100 nodes, once a second for 22 hours."""
LONGEST_LINE: Final = 1_000_000
"""Characters of a line."""
LONGEST_NAME: Final = 200
"""Characters of a text, such as the name of a node (our choice)."""
LONGEST_SHOWN: Final = 60
"""Characters of a cell in a message."""
IDENTIFIER: Final = re.compile(
    r"(id|name|node|mote|mac|addr|address|receiver|anchor|beacon|station|tag|vehicle|person|label)$", re.IGNORECASE
)
"""Names of columns that look like identifiers (our choice)."""
LOOKED_AT: Final = 20_000
"""Rows in which columns that are not read are looked at (our choice)."""
CHUNK: Final = 100_000
"""Rows that are read at once."""
BLANK: Final = ' \t\r\n,"'
"""The characters of a line without a cell."""
DELIMITERS: Final = {";": "semicolons", "\t": "tabs", "|": "vertical bars"}


@dataclass(frozen=True, slots=True)
class Wanted:
    """The columns that are read: {our name: name in the file's header}.

    Attributes:
        texts: columns of texts, which are stripped and must not be empty.
        numbers: columns of finite numbers.
        optional: our names of the columns that a file may lack.
        read: what reads the cells of columns of numbers other than `number_in`; NaN where it cannot.
    """

    texts: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, str] = field(default_factory=dict)
    optional: Sequence[str] = ()
    read: Mapping[str, Callable[[str], float]] = field(default_factory=dict)


class TextCells(NamedTuple):
    """The wanted columns of a file before they are checked, by our names.

    Attributes:
        lines: (n,) line of each row.
        texts: (n,) texts of each column that the file has.
        numbers: (n,) numbers of each column that the file has; NaN for a cell that holds none.
        odd: {column: {row: its cell}} where that is no finite number, of the first such rows.
    """

    lines: Ints
    texts: Mapping[str, TextColumn]
    numbers: Mapping[str, Floats]
    odd: Mapping[str, Mapping[int, str]]

    def shown(self, name: str, row: int) -> str:
        """The number in a row as messages show it."""
        return repr(self.odd[name].get(row, f"{self.numbers[name][row]:g}")[:LONGEST_SHOWN])


def read_cells(path: str, file: Any, wanted: Wanted, what: str, first: int = 1) -> TextCells:
    """The wanted columns of every line of an open text that is not blank, from its header in the line `first` on.

    Raises:
        RunError: the file lacks a column, has no row, or more than `MOST_ROWS` rows.
        ValueError: it is no CSV text; `open_text` says so.
    """
    import pandas as pd  # a run that reads no file does without

    lines = _TextLines(path, file, first)
    header = next(cells_in([lines.header]), [])
    places = _present(path, first, header, wanted, what)
    known: dict[str, dict[str, int]] = {name: {} for name in wanted.texts if name in places}
    odd: dict[str, dict[int, str]] = {name: {} for name in places if name not in known}
    parts: dict[str, list[Any]] = {name: [] for name in places}
    with pd.read_csv(
        lines, header=0, names=range(len(header)), usecols=sorted({*places.values()}), index_col=False, dtype=object,
        na_filter=False, skip_blank_lines=False, chunksize=CHUNK,
    ) as chunks:  # fmt: skip
        for chunk in chunks:
            for name, place in places.items():
                codes, cells = pd.factorize(chunk[place])
                if name in known:
                    values = np.array([known[name].setdefault(cell.strip(), len(known[name])) for cell in cells], int)
                else:
                    values = np.array([*map(wanted.read.get(name, number_in), cells)])
                    wrong = np.flatnonzero(~np.isfinite(values)[codes])[
                        : max(row_checks.MOST_BAD + 1 - len(odd[name]), 0)
                    ]
                    odd[name] |= {int(chunk.index[row]): cells[codes[row]].strip() for row in wrong.tolist()}
                parts[name].append(values[codes])
    if not lines.numbers:
        raise RunError(f"{path}: contains no {what}")
    columns = {name: np.concatenate(each) for name, each in parts.items()}
    if any(len(column) != len(lines.numbers) for column in columns.values()):
        raise ValueError("a cell in quotation marks goes over several lines")
    texts = {name: TextColumn(tuple(words), columns.pop(name)) for name, words in known.items()}
    return TextCells(np.array(lines.numbers), texts, columns, odd)


def read_rows(path: str, wanted: Wanted, what: str) -> CsvRows:
    """The wanted columns of every line that is not blank; rows whose cells are missing or no finite number are apart.

    Raises:
        RunError: the file cannot be read, lacks a column, has no row, or more than `MOST_ROWS` rows or `MOST_BAD` bad
            ones.
    """
    with open_text(path) as file:
        cells = read_cells(path, file, wanted, what)
    checks: list[row_checks.Check] = []
    for name, column in cells.texts.items():
        checks.append((column.where(lambda word: not word), f"{name} must not be empty"))
        long = column.where(lambda word: len(word) > LONGEST_NAME)
        checks.append((long, f"{name} must have at most {LONGEST_NAME} characters"))

    def said(name: str, row: int) -> str:
        return f"{wanted.numbers[name]} must be a finite number, is {cells.shown(name, row)}"

    checks += [(~np.isfinite(values), functools.partial(said, name)) for name, values in cells.numbers.items()]
    return CsvRows(path, cells.lines, cells.texts, cells.numbers).without(*checks)


def only_rows(path: str, wanted: Wanted, what: str) -> CsvRows:
    """As `read_rows`, for files in which a row left out would shift the others.

    Raises:
        RunError: as there, or a row cannot be used. The message names file and line.
    """
    return demand_good(read_rows(path, wanted, what))


def timed_rows(path: str, what: str, *optional: str) -> CsvRows:
    """As `only_rows`: the column `time` (s), and of the optional columns of numbers those that the file has.

    Raises:
        RunError: as there, or the times do not ascend from 0 s on.
    """
    rows = only_rows(path, Wanted(numbers={name: name for name in ("time", *optional)}, optional=optional), what)
    times = rows.numbers["time"]
    for row in np.flatnonzero((np.diff(times, prepend=-np.inf) <= 0.0) | (times < 0.0))[:1].tolist():
        raise RunError(f"{path}:{rows.lines[row]}: times must ascend from 0 s on, is {times[row]:g} s")
    return rows


def demand_good(rows: CsvRows) -> CsvRows:
    """The rows. Raises RunError if one was bad; the message names file and line."""
    if rows.bad:
        raise RunError(row_checks.summarised(f"{rows.path}:{row.line}: {row.reason}" for row in rows.bad)[0])
    return rows


def identifiers(path: str, read: Collection[str]) -> dict[str, list[str]]:
    """The cells, in the first `LOOKED_AT` rows, of the columns that are not `read` and look like identifiers.

    Their names say so (`IDENTIFIER`), and their cells are words or whole numbers.

    Raises:
        RunError: the file cannot be read.
    """
    with open_text(path) as file:
        columns = [*itertools.zip_longest(*itertools.islice(filter(any, cells_in(file)), LOOKED_AT), fillvalue="")]
    return {
        name: cells
        for name, *cells in columns
        if name not in read
        and IDENTIFIER.search(name)
        and all(cell and not number_in(cell) % 1.0 > 0.0 for cell in cells)
    }


def cells_in(lines: Iterable[str], separator: str = ",") -> Iterator[list[str]]:
    """Yield the stripped cells of each line."""
    return ([cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator))


IMPORTED: Final = {"readings": "readings", "nodes": "nodes", "positions": "nodes", "points of a trajectory": "track"}
"""{what a file contains: the kind of `wsnsim import` that makes such files of tables}."""


@contextlib.contextmanager
def open_text(path: str) -> Iterator[Any]:
    """Open a UTF-8 text, or UTF-16 with its mark, perhaps in gzip; what cannot be read in the block is a RunError too.

    Raises:
        RunError: the file cannot be read, is no text, is empty, or is not the gzip data that its name promises.
    """
    if irregular := why_not_regular(path):
        raise RunError(f"{path}: cannot be read: {irregular}")
    try:
        with Path(path).open("rb") as file, _decompressed(path, file) as content:
            wide = content.peek(2)[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
            yield _LimitedText(content, encoding="utf-16" if wide else "utf-8-sig", newline="")
    except UnicodeDecodeError as error:
        remedy = f"save it as CSV UTF-8, or write: iconv -f latin1 -t utf-8 {shlex.quote(path)}"
        raise RunError(f"{path}: cannot be read: not a CSV text in UTF-8 ({error}): {remedy}") from error
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


class _TextLines:
    """The lines of a text that are not blank, as pandas reads them; the header is read first.

    Attributes:
        numbers: those of the lines that were read, without the header's.
    """

    def __init__(self, path: str, file: Any, first: int) -> None:
        self.header = file.readline()
        self.numbers = array("q")
        self._path, self._unread, self._lines = path, self.header, enumerate(file, first + 1)

    def __iter__(self) -> Iterator[str]:
        """pandas asks for it, and uses `read`."""
        return iter(())

    def read(self, size: int) -> str:
        """Lines with so many characters or a few more. Raises RunError if they are more than `MOST_ROWS` in all."""
        found, self._unread = [self._unread], ""
        for number, line in self._lines:
            if line.strip(BLANK):
                self.numbers.append(number)
                if len(self.numbers) > MOST_ROWS:
                    said = f"has more than {MOST_ROWS:,} rows: split it, or thin it out"
                    raise RunError(f"{self._path}:{number}: {said}")
                found.append(line)
                size -= len(line)
                if size <= 0:
                    break
        return "".join(found)


def _present(path: str, first: int, header: list[str], wanted: Wanted, what: str) -> dict[str, int]:
    """The index of each wanted column that a file has, by our names."""
    named = {**wanted.texts, **wanted.numbers}
    needed = tuple(theirs for ours, theirs in named.items() if ours not in wanted.optional)
    if missing := set(needed) - set(header):
        error = _without_columns(f"{path}:{first}", header, needed)
        if what == "readings" and missing <= {named.get("x"), named.get("y")}:
            raise RunError(f"{error}; a trajectory in a file of its own: --track FILE")
        if kind := IMPORTED.get(what):
            raise RunError(f"{error}; a table of another form: wsnsim import {kind} {shlex.quote(path)}")
        raise error
    for twice in (name for name in named.values() if header.count(name) > 1):
        said = f"the header names the column '{twice}' twice: rename one of them, or delete it"
        raise RunError(f"{path}:{first}: {said}")
    return {ours: header.index(theirs) for ours, theirs in named.items() if theirs in header}


def _without_columns(place: str, header: list[str], names: Sequence[str]) -> RunError:
    """The error of a header that lacks columns: what it has, and which delimiter it seems to use."""
    listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
    words = f"{place}: the header must name the columns {listed}, for example '{','.join(names)}'"
    joined = ",".join(header)
    used = next((word for sign, word in DELIMITERS.items() if sign in joined), "")
    hint = f"; it seems to use {used}, only commas are allowed" if used else ""
    return RunError(words + (f", is '{joined[:200]}'{hint}" if joined else ", the file is empty"))


def number_in(cell: str) -> float:
    """The number that a cell holds; NaN if it holds none."""
    try:
        return float(cell.replace("_", "no digit"))
    except ValueError:
        return math.nan
