"""The rows of data files: those that can be used, what finds the others, and the messages that name these.

rows.without(*checks) -> CsvRows    refused(lines, *checks) -> bad rows    bad_rows_text(path, bad, rows) -> a message
"""

from __future__ import annotations

import dataclasses
import itertools
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import MOST_PRINTED, RunError

MOST_BAD: Final = 100_000
"""Rows of one file that may be left out because they cannot be used (our choice)."""
SKIPPING: Final = "skip_bad_rows: true leaves them out, and the result names them"
"""What helps a scenario whose file has bad rows."""
SkipBadRows: TypeAlias = Annotated[
    bool, "whether rows that cannot be used are left out and counted, instead of refused"
]
VARYING: Final = re.compile(r"""'[^']*+'|"[^"]*+"|[-+]?\d[-+\d.,e]*+|nan|inf""")
"""What differs between messages on rows with equal errors."""
DATED: Final = re.compile(r"must be a finite number, is '\d{4}-\d\d-\d\d")
"""What is said of a cell that holds a date."""


@dataclass(frozen=True, slots=True)
class BadRow:
    """A row of a file that cannot be used: its line, and what is wrong and allowed."""

    line: int
    reason: str


class TextColumn(NamedTuple):
    """(n,) texts, each of which is kept once: `names[codes[i]]` is that of row i. Names are in the file's order."""

    names: tuple[str, ...]
    codes: Ints

    def where(self, holds: Callable[[str], bool]) -> Bools:
        """(n,) in which rows the text has this property."""
        return np.array([*map(holds, self.names)], dtype=np.bool_)[self.codes]

    def only(self, rows: Bools | Ints) -> TextColumn:
        """The texts of some rows."""
        used, codes = np.unique(self.codes[rows], return_inverse=True)
        return TextColumn(tuple(self.names[code] for code in used.tolist()), codes)


@dataclass(frozen=True, slots=True)
class CsvRows:
    """The good rows of a file, by our names of the columns, in the file's order.

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
    bad: tuple[BadRow, ...] = ()

    def without(self, *checks: Check, skip: bool = True, remedy: str = "") -> CsvRows:
        """The rows that no check refuses.

        Args:
            *checks: Checks of these rows; of several that refuse a row, the first gives the reason.
            skip: Whether other rows are left out, instead of refused.
            remedy: What the message says that leaves them out.

        Raises:
            RunError: A row is refused; or there are more than `MOST_BAD` such rows.
        """
        bad = tuple(limited(self.path, itertools.chain(self.bad, refused(self.lines, *checks))))
        if bad and not skip:
            raise RunError(bad_rows_text(self.path, bad, self.total, remedy))
        if len(bad) == len(self.bad):
            return self
        return dataclasses.replace(self.at(~np.isin(self.lines, [row.line for row in bad])), bad=bad)

    def at(self, rows: Bools | Ints) -> CsvRows:
        """Some of the good rows, by a mask (n,) or by their numbers in another order."""
        texts = {name: column.only(rows) for name, column in self.texts.items()}
        numbers = {name: values[rows] for name, values in self.numbers.items()}
        return CsvRows(self.path, self.lines[rows], texts, numbers, self.bad)

    def nodes_once(self, name: str) -> Check:
        """Which rows name a node that an earlier one names in the same column."""
        names, codes = self.texts[name]
        first = first_of_equal(np.ones(len(codes), dtype=np.bool_), codes)
        return first != np.arange(
            len(codes)
        ), lambda row: f"the node '{names[codes[row]]}' stands in line {self.lines[first[row]]} already"

    @property
    def total(self) -> int:
        """The number of good and bad rows."""
        return len(self.lines) + len(self.bad)

    @property
    def points(self) -> Floats:
        """(n, 3) the columns x, y and z; NaN for a z that the file lacks."""
        unknown = np.full(len(self.lines), np.nan)
        return np.column_stack([self.numbers.get(axis, unknown) for axis in "xyz"])


Check: TypeAlias = tuple[Bools, str | Callable[[int], str]]
"""Which rows (n,) cannot be used, and why: a sentence for all, or what says it of the row with this number."""


def refused(lines: Ints, *checks: Check) -> Iterator[BadRow]:
    """Yield the rows in the lines (n,) that a check refuses, with the reason of the first one that does."""
    for row in np.flatnonzero(np.any([wrong for wrong, _ in checks], axis=0)).tolist():
        reason = next(reason for wrong, reason in checks if wrong[row])
        yield BadRow(int(lines[row]), reason if isinstance(reason, str) else reason(row))


def bad_rows_text(path: str, bad: Sequence[BadRow], rows: int, remedy: str = "") -> str:
    """A message that names the first row with each error of a file, of `rows` in all, and what helps."""
    if all(DATED.search(row.reason) for row in bad):
        dates = f"times are seconds; write: wsnsim import readings (or track) {shlex.quote(path)}, which reads dates"
        return f"{path}:{bad[0].line}: {bad[0].reason}{more_like_it(len(bad) - 1)}: {dates}"
    said = f"{path}: {len(bad):,} of {rows:,} rows cannot be used:"
    return "\n  ".join([said, *summarised(row_texts(path, bad)), *([remedy] if remedy else [])])


def limited(path: str, bad: Iterable[BadRow]) -> list[BadRow]:
    """The bad rows of a file, ascending. Raises RunError where there are more than `MOST_BAD`."""
    rows = sorted(itertools.islice(bad, MOST_BAD + 1), key=lambda row: row.line)
    if len(rows) > MOST_BAD:
        said = f"{path}: more than {MOST_BAD:,} rows cannot be used:"
        raise RunError("\n  ".join([said, *summarised(row_texts(path, rows)), "and more"]))
    return rows


def row_texts(path: str, bad: Sequence[BadRow]) -> list[str]:
    """Bad rows, a text each with file, line and reason, without the file's folder."""
    return [f"{Path(path).name}:{row.line}: {row.reason}" for row in bad]


def more_like_it(more: int, remedy: str = "") -> str:
    """What follows a message on a row if so many more rows have the same error; and what helps."""
    also = f"; {remedy}" if remedy else ""
    return f" ({more:,} more row{'s' * (more > 1)} like it{also})" if more else ""


def summarised(texts: Iterable[str]) -> list[str]:
    """The first of the texts on rows with equal errors, with the number of the others; of each of `MOST_PRINTED`."""
    alike: dict[str, list[str]] = {}
    for text in texts:
        alike.setdefault(VARYING.sub("", text), []).append(text)
    said = [each[0] + more_like_it(len(each) - 1) for each in alike.values()]
    left = len(said) - MOST_PRINTED
    return [*said[:MOST_PRINTED], *([f"and {left:,} other kinds of errors"] if left > 0 else [])]


def first_of_equal(among: Bools, *keys: Floats | Ints) -> Ints:
    """(n,) the index of the first row with the same keys (n,), of those `among` which it is sought; else its own."""
    import pandas as pd

    first, rows = np.arange(len(among)), np.flatnonzero(among)
    first[rows] = pd.Series(rows).groupby([key[rows] for key in keys]).transform("first")
    return first
