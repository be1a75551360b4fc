"""What the pictures of a campaign are drawn from: which key is swept, and which points make a line.

lines_of(folder, metric="rmse", key=None) -> SweepLines
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wsnsim.analysis import campaigns, comparison, plot_data
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.tables import TABLES
from wsnsim.recording.folder import Folder, Manifest
from wsnsim.scenario import load

UNIT: Final = re.compile(r"\[([^\[\]]+)\]$")
"""How a field's description ends that has a unit."""
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class SweepLine:
    """Points that differ in the swept key alone: `rows` of the table, in the order of that key.

    `colour` counts the values of the first of the other keys, `dash` what the rest of them say.
    """

    label: str
    rows: tuple[int, ...]
    colour: int
    dash: int


@dataclass(frozen=True)
class SweepLines:
    """A campaign's figures against one swept key.

    `unit` is the key's, `metric_unit` the metric's. `places`: (rows,) where each row of the table stands; NaN where its
    point lacks the key. `words`: of the places 0, 1, ..., if the key's values are no numbers. `joined`: whether a line
    may join its points, which it may not where other keys go up and down along it. `against`: what differences are
    taken from.
    """

    found: comparison.Comparison
    key: str
    unit: str
    metric_unit: str
    places: Floats
    words: tuple[str, ...]
    lines: tuple[SweepLine, ...]
    joined: bool
    against: str

    def column(self, name: str, line: SweepLine) -> Floats:
        """A column of the table along a line."""
        return self.found.table[name].to_numpy(dtype=np.float64)[list(line.rows)]

    @property
    def runs(self) -> str:
        """How many replicates a point has, in words."""
        counts = self.found.table["replicates"]
        low, high = int(counts.min()), int(counts.max())
        return f"{low:,} run{'s' * (low != 1)}" if low == high else f"{low:,} to {high:,} runs"


def lines_of(folder: Folder, metric: str = "rmse", key: str | None = None) -> SweepLines:
    """The campaign's points as lines over a key: the one asked for, or the number that takes the most values.

    Differences are between lines (colours) at the same value of the key; of a single line, from its first point.

    Raises:
        UsageError: the campaign varies no such key, or the metric is none. ResultError: there are no results.
    """
    manifest = folder.manifest()
    settings = [point.settings for point in manifest.points]
    swept = _swept(manifest, settings, key)
    others, companions = _others(manifest, settings, swept)
    by = _along(others[0], others[1:], manifest.keys, settings, swept) if others else (swept, *companions)
    baseline = manifest.baseline if set(by) == set(manifest.by) else None
    found = comparison.compare(folder, metric, [key for key in manifest.keys if key in by], baseline)
    here = [settings[number] for number in found.table[campaigns.POINT]]
    places, words = _places([said.get(swept) for said in here])
    units = {name: _unit(folder, manifest, name) for name in (swept, *others)}
    lines = _lines(here, places, others, units)
    first = baseline or _label(here[min(lines[0].rows)], others[:1] or (swept,), units)
    return SweepLines(
        found=found,
        key=swept,
        unit=units[swept],
        metric_unit=_unit_of_metric(folder, manifest, metric),
        places=places,
        words=words,
        lines=lines,
        joined=not words and all(_is_ordered(here, line, companions) for line in lines),
        against=first,
    )


def _swept(manifest: Manifest, settings: Sequence[Settings], wanted: str | None) -> str:
    """The key that is drawn against: numbers before words, many values before few, what is compared last."""
    if wanted is not None and wanted not in manifest.keys:
        raise UsageError(f"{manifest.name} varies no '{wanted}' ({did_you_mean(wanted, manifest.keys)})")
    if not manifest.keys:
        raise UsageError(f"{manifest.name} varies nothing: there is nothing to draw against")

    def rank(key: str) -> tuple[bool, bool, int]:
        values = {said[key] for said in settings if key in said}
        return key not in manifest.by, all(_is_number(value) for value in values), len(values)

    return wanted or max(manifest.keys, key=rank)


def _others(manifest: Manifest, settings: Sequence[Settings], swept: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(keys that set lines apart, what is compared first; keys that only follow the swept one)."""
    others: list[str] = []
    companions = []
    for key in [*manifest.by, *(key for key in manifest.keys if key not in manifest.by)]:
        if key == swept or (others and _follows(settings, key, others)):
            continue
        if _follows(settings, key, [swept]):
            companions.append(key)
        else:
            others.append(key)
    return tuple(others), tuple(companions)


def _along(
    first: str, rest: Sequence[str], keys: Sequence[str], settings: Sequence[Settings], swept: str
) -> tuple[str, ...]:
    """The key whose values are compared, and those that change with it alone."""
    held = (swept, *rest)
    return (first, *(k for k in keys if k not in (first, *held) and not _follows(settings, k, held)))


def _follows(settings: Sequence[Settings], key: str, leaders: Sequence[str]) -> bool:
    """Whether the values of some keys settle that of another."""
    known: dict[tuple[Any, ...], Any] = {}
    return all(
        known.setdefault(tuple(said.get(leader) for leader in leaders), said.get(key)) == said.get(key)
        for said in settings
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _places(values: Sequence[Any]) -> tuple[Floats, tuple[str, ...]]:
    """(rows,) where values stand on the axis, and the words there if they are no numbers."""
    if all(_is_number(value) for value in values if value is not None):
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64), ()
    words = tuple(dict.fromkeys(str(value) for value in values if value is not None))
    return np.array([np.nan if value is None else words.index(str(value)) for value in values]), words


def _lines(
    here: Sequence[Settings], places: Floats, others: Sequence[str], units: Mapping[str, str]
) -> tuple[SweepLine, ...]:
    rows: dict[tuple[str, ...], list[int]] = {}
    for row in np.argsort(places, kind="stable"):
        if np.isfinite(places[row]):
            rows.setdefault(tuple(repr(here[row].get(key)) for key in others), []).append(int(row))
    ordered = sorted(rows.items(), key=lambda item: min(item[1]))
    colours = list(dict.fromkeys(key[:1] for key, _ in ordered))
    dashes = list(dict.fromkeys(key[1:] for key, _ in ordered))
    return tuple(
        SweepLine(_label(here[found[0]], others, units), tuple(found), colours.index(key[:1]), dashes.index(key[1:]))
        for key, found in ordered
    )


def _label(said: Settings, keys: Iterable[str], units: Mapping[str, str]) -> str:
    """'ipf, step 10 s': values of keys, the numbers among them with their names."""
    return ", ".join(_words(key, said[key], units[key]) for key in keys if key in said)


def _words(key: str, value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    name = key.rpartition(".")[2].replace("_", " ")
    return f"{name} {value:g}{f' {unit}' if unit else ''}" if _is_number(value) else f"{name} {value}"


def _is_ordered(here: Sequence[Settings], line: SweepLine, companions: Iterable[str]) -> bool:
    """Whether the numbers that follow the swept key only rise, or only fall, along a line."""
    for key in companions:
        values = [here[row].get(key) for row in line.rows]
        if all(_is_number(value) for value in values):
            steps = np.diff(np.array(values, dtype=np.float64))
            if not ((steps >= 0).all() or (steps <= 0).all()):
                return False
    return True


def _unit(folder: Folder, manifest: Manifest, key: str) -> str:
    """The unit of a key of the scenario; '' for a pure number, a word, or a key that nothing describes."""
    point = next((point for point in manifest.points if key in point.settings), None)
    if point is None or key == "scenario":
        return ""
    model: Any = load(json.loads(folder.scenario(point.id)))
    *path, name = key.split(".")
    for word in path:
        model = getattr(model, word, None)
    field = getattr(type(model), "model_fields", {}).get(name)
    unit = UNIT.search(field.description or "") if field else None
    return unit[1] if unit else ""


def _unit_of_metric(folder: Folder, manifest: Manifest, metric: str) -> str:
    """The metric's unit; an error's is that of the positions."""
    column = next(column for column in TABLES["runs"] if column.name == metric)
    if not column.of_position:
        return "" if column.units == "1" else column.units
    batches = (batch for point in manifest.points for batch in folder.batches(point.id))
    layout = plot_data.layout(next(batches).path)
    return layout.units[layout.position[0]]
