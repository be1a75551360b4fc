"""What a result holds, compared with its repetition: its tables, run by run, and its source text.

compare_tables(result, again) -> ({replicate: its tables}, faults)        bit by bit, and up to rounding
compare_source(content, overrides, resolved) -> (what differs, what could not be compared)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.recording as recording
from wsnsim.base.errors import ScenarioError
from wsnsim.scenario.build import differing_leaves
from wsnsim.scenario.build import resolved as resolved_of
from wsnsim.scenario.check import is_path, validated
from wsnsim.scenario.load import assignments_of, load
from wsnsim.scenario.points import value_at
from wsnsim.scenario.python_values import of_dict
from wsnsim.scenario.reader import read, read_scenario
from wsnsim.scenario.registry import Plugins
from wsnsim.scenario.texts import Entry, LocatedValue, Origin, ScenarioText, shipped

ROUNDING: Final = 1e-6
"""Differences up to this share of a value, or up to a thousandth of it of the column's largest one, are rounding."""
DIGESTS: Final = ("fingerprint", "event_fingerprint")
"""Columns of `runs` that change completely with any bit of a run."""
NOT_REPEATED: Final = {"runs": ("cpu_seconds",)}
"""Columns that do not follow from the scenario."""
Columns = Mapping[str, np.ndarray]


class RepeatedTable(NamedTuple):
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
    def close(self) -> bool:
        """Whether both have the same rows up to rounding."""
        return not self.wrong and self.rows[0] == self.rows[1]


def compare_tables(
    result: Path, again: Path, partial: bool = False
) -> tuple[dict[int, list[RepeatedTable]], list[str]]:
    """Compare all tables of a result with those of its repetition.

    Args:
        result: the result.
        again: its repetition.
        partial: whether later rows of a table may be missing.

    Returns:
        {replicate: its tables}, and what only one of the two has, as sentences.

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
    return runs, faults


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


OF_THE_RUN = ("replicates",)
"""Keys that the command line may set without an override."""


def compare_source(
    content: str, overrides: Iterable[str], resolved: Mapping[str, Any], plugins: Plugins = Plugins.INSTALLED
) -> tuple[list[str], list[str]]:
    """What differs, as sentences, and what could not be compared.

    What a text takes from a file that does not come with wsnsim is not compared: such a file is never opened.

    Args:
        content: the text from which the scenario was read.
        overrides: the assignments with which it was read.
        resolved: all values of the scenario.
        plugins: which plug-ins all of these may name.
    """
    origin = Origin("", Path(), plugins=plugins)
    tree, issues = read(content, origin)
    if tree is None or issues or not isinstance(tree.value, dict):
        return ["its source text is not a scenario"], []
    base, own, unknown = _base_of(_with_stored_files(tree, resolved), resolved)
    written, wrong = assignments_of(overrides, plugins)
    assignments = [(keys, _with_stored_files(node, value_at(resolved, keys), str(keys[-1]))) for keys, node in written]
    text = ScenarioText(own if base is None else base.merged(own), wrong, ("", ""))
    try:
        known, found = load(resolved, plugins=plugins), validated(text, assignments)
    except ScenarioError as error:
        return [f"its source text is not a valid scenario: {error.issues[0].message}"], unknown
    differing = differing_leaves(resolved_of(known), resolved_of(found), OF_THE_RUN)
    said = [
        f"{key}: its source text says {after}, the stored scenario {before}"
        for key, (before, after) in differing.items()
    ]
    return said, unknown


def _base_of(tree: LocatedValue, resolved: Mapping[str, Any]) -> tuple[LocatedValue | None, LocatedValue, list[str]]:
    """What the text extends, its own values, and what is not known of the base.

    In place of a base that does not come with wsnsim stands the stored scenario: only the text's own values count.
    """
    entry = tree.value.get("extends")
    if entry is None:
        return None, tree, []
    own = LocatedValue({key: value for key, value in tree.value.items() if key != "extends"}, tree.spot)
    root = next(iter(shipped().values())).parent
    name = str(entry.node.plain())
    for folder in (root, root / "bases"):
        path = folder / name
        if path.suffix and path.is_file() and path.resolve().is_relative_to(root):
            return read_scenario(path).tree, own, []
    note = f"what its source text takes from {name!r}, a file that does not come with wsnsim"
    return of_dict(dict(resolved), tree.spot.origin)[0], own, [note]


def _with_stored_files(node: LocatedValue, stored: Any, key: str = "") -> LocatedValue:
    """The values with the stored file where a relative name ends it: the folder of the text is not known."""
    if isinstance(node.value, dict):
        held = stored if isinstance(stored, dict) else {}
        items = node.value.items()
        return LocatedValue(
            {name: Entry(one.spot, _with_stored_files(one.node, held.get(name), name)) for name, one in items},
            node.spot,
        )
    if isinstance(node.value, list):
        kept = stored if isinstance(stored, list) and len(stored) == len(node.value) else [None] * len(node.value)
        return LocatedValue(
            [_with_stored_files(one, held) for one, held in zip(node.value, kept, strict=True)], node.spot
        )
    if is_path(key) and isinstance(node.value, str) and isinstance(stored, str) and _ends(stored, node.value):
        return replace(node, value=stored)
    return node


def _ends(stored: str, written: str) -> bool:
    """Whether a stored path ends with a relative one, apart from steps to parent folders."""
    parts = [part for part in Path(written).parts if part not in (".", "..")]
    return bool(parts) and not Path(written).is_absolute() and list(Path(stored).parts[-len(parts) :]) == parts
