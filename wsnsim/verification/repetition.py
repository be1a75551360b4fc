"""Whether the tables of a result are those of its repetition, run by run: bit by bit, and up to rounding.

compare(result, again) -> Repetition
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

import wsnsim.recording as recording

ROUNDING: Final = 1e-6
"""Differences up to this share of a value, or up to a thousandth of it of the column's largest one, are rounding."""
DIGESTS: Final = ("fingerprint", "event_fingerprint")
"""Columns of `runs` that change completely with any bit of a run."""
NOT_REPEATED: Final = {"runs": ("cpu_seconds",)}
"""Columns that do not follow from the scenario."""
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class RepeatedTable:
    """One table of one run, compared with its repetition.

    Attributes:
        table: name of the table.
        rows: number of its rows in the result, and in the repetition.
        differing: columns whose values are not equal bit by bit (NaN equals NaN).
        wrong: those that differ by more than rounding.
    """

    table: str
    rows: tuple[int, int]
    differing: tuple[str, ...]
    wrong: tuple[str, ...]

    @property
    def equal(self) -> bool:
        """Whether both have the same rows, bit by bit."""
        return not self.differing and self.rows[0] == self.rows[1]

    @property
    def close(self) -> bool:
        """Whether both have the same rows up to rounding."""
        return not self.wrong and self.rows[0] == self.rows[1]


@dataclass(frozen=True)
class Repetition:
    """A result, compared with its repetition.

    Attributes:
        runs: {replicate: its tables}.
        faults: what only one of the two has, as sentences.
    """

    runs: Mapping[int, tuple[RepeatedTable, ...]]
    faults: tuple[str, ...]


def compare(result: Path, again: Path, partial: bool = False) -> Repetition:
    """Compare all tables of a result with those of its repetition; `partial`: later rows of a table may be missing.

    Raises:
        ResultError: one of them cannot be read.
    """
    held, wanted = recording.tables(result), recording.tables(again)
    replicates = recording.read_table(again, "runs", ["replicate"])["replicate"].tolist()
    faults = [f"has no table {name}, which its scenario records" for name in wanted if name not in held]
    faults += [f"has a table {name}, which its scenario does not record" for name in held if name not in wanted]
    faults += _other_states(result, again)
    runs: dict[int, list[RepeatedTable]] = {replicate: [] for replicate in replicates}
    for name in (name for name in wanted if name in held):
        extra = [column for column in held[name].columns if column not in wanted[name].columns]
        faults += [f"has a column {name}.{column}, which a run does not write" for column in extra]
        absent = [column for column in wanted[name].columns if column not in held[name].columns]
        faults += [f"has no column {name}.{column}" for column in absent]
        stray = _compare_table(result, again, name, runs, partial)
        faults += [f"table {name} has {stray} rows of runs that are not in the table runs"] if stray else []
        faults += _two_answers(result, name)
    return Repetition({number: tuple(found) for number, found in runs.items()}, tuple(faults))


def _other_states(result: Path, again: Path) -> Iterator[str]:
    """What the attributes of both files say of the state, where it is not the same."""
    one, other = recording.attributes(result), recording.attributes(again)
    for name in ("states", "position"):
        if one[name] != other[name]:
            yield f"its attribute {name} is {one[name]}, its scenario gives {other[name]}"


def _compare_table(
    result: Path, again: Path, table: str, runs: Mapping[int, list[RepeatedTable]], partial: bool
) -> int:
    """Append a table's comparison to each run; returns how many rows belong to none of them."""
    stored, repeated = _columns(result, table), _columns(again, table)
    numbers = {side: columns[0]["replicate"] for side, columns in (("a", stored), ("b", repeated))}
    names = [name for name in repeated[0] if name in stored[0] and name not in NOT_REPEATED.get(table, ())]
    for replicate, found in runs.items():
        one, other = (np.flatnonzero(numbers[side] == replicate) for side in "ab")
        sizes = one.size, min(one.size, other.size) if partial else other.size
        both = min(sizes)
        differing, wrong = [], []
        for name in names:
            pair = stored[0][name][one[:both]], repeated[0][name][other[:both]]
            if name in stored[1] or name in repeated[1]:
                pair = pair[0], _recoded(pair[1], repeated[1].get(name, ()), stored[1].get(name, ()))
            if not _equal(*pair):
                differing.append(name)
                wrong += [] if name in DIGESTS or _close(*pair) else [name]
        found.append(RepeatedTable(table, sizes, tuple(differing), tuple(wrong)))
    return int(np.count_nonzero(~np.isin(numbers["a"], list(runs))))


def _columns(path: Path, table: str) -> tuple[Columns, Mapping[str, tuple[str, ...]]]:
    """The columns of a table, and the words of its category columns."""
    words = recording.all_meanings(path, table)
    return recording.read_table(path, table), {name: each for name, each in words.items() if each}


def _two_answers(result: Path, table: str) -> Iterator[str]:
    """Where the rows of a short table, which the file also holds in one piece, differ from its columns."""
    columns, packed = recording.read_table(result, table), recording.read_with_meanings(result, table)[0]
    for name, values in packed.items():
        if name not in columns or not _equal(columns[name], values):
            yield f"holds two different columns {table}.{name}: that of the table, and that of its attribute rows"


def _recoded(codes: np.ndarray, words: tuple[str, ...], others: tuple[str, ...]) -> np.ndarray:
    """Codes of category words as the codes that another file has for the same words; -1 where it has none."""
    table = np.full(max(len(words), 256), -1)
    table[: len(words)] = [others.index(word) if word in others else -1 for word in words]
    recoded: np.ndarray = table[codes]
    return recoded


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    floats = one.dtype.kind == "f" or other.dtype.kind == "f"
    return bool(np.array_equal(one, other, equal_nan=floats))


def _close(one: np.ndarray, other: np.ndarray) -> bool:
    if one.dtype.kind != "f" or other.dtype.kind != "f":
        return False
    finite = other[np.isfinite(other)]
    scale = float(np.abs(finite).max()) if finite.size else 0.0
    return bool(np.allclose(one, other, rtol=ROUNDING, atol=1e-3 * ROUNDING * scale, equal_nan=True))
