"""The data of a campaign's plots: the key on the axis, and the points that make up each line.

lines_of(folder, metric="rmse", key=None) -> SweepLines
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns, comparison
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.recording.folder import Folder, Manifest
from wsnsim.scenario import Plugins, load
from wsnsim.scenario.registry import refused

UNIT: Final = re.compile(r"\[([^\[\]]+)\]$")
"""The unit at the end of a field's description."""
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class SweepLine:
    """The points that differ only in the swept key.

    Attributes:
        label: the values of the other keys.
        rows: rows of the table, in the order of the swept key.
        colour: number of the value of the first other key.
        dash: number of the values of the remaining keys.
    """

    label: str
    rows: tuple[int, ...]
    colour: int
    dash: int


@dataclass(frozen=True)
class SweepLines:
    """A comparison over one swept key.

    Attributes:
        found: the comparison.
        key: the swept key.
        unit: unit of the swept key.
        places: (rows,) the place of each row of the table on the axis, NaN for points without the key.
        words: the values at the places 0, 1, ... if they are not numbers.
        lines: the lines.
        joined: whether a line joins its points; not if other keys rise and fall along it.
        against: the point or line that differences are from.
    """

    found: comparison.Comparison
    key: str
    unit: str
    places: Floats
    words: tuple[str, ...]
    lines: tuple[SweepLine, ...]
    joined: bool
    against: str

    def column(self, name: str, line: SweepLine) -> Floats:
        """A column of the table along a line, (points,)."""
        column: Floats = self.found.table[name].to_numpy(dtype=np.float64)[list(line.rows)]
        return column

    @property
    def runs(self) -> str:
        """The number of runs per point as a text."""
        counts = self.found.table["replicates"]
        low, high = int(counts.min()), int(counts.max())
        return f"{low:,} run{'s' * (low != 1)}" if low == high else f"{low:,} to {high:,} runs"


def lines_of(folder: Folder, metric: str = "rmse", key: str | None = None) -> SweepLines:
    """The points of a campaign as lines over a key.

    Differences are between lines (colours) at the same value of the key, or from the first point of a single line.

    Args:
        folder: folder of the campaign.
        metric: a column of `runs`.
        key: the swept key on the axis; by default the numeric key with the most values.

    Raises:
        UsageError: the campaign does not vary the key, or there is no such metric.
        ResultError: there are no results.
    """
    manifest = folder.manifest()
    settings = [point.settings for point in manifest.points]
    swept = _swept(manifest, settings, key)
    others, companions = _others(manifest, settings, swept)
    by = (swept, *companions)
    if others:  # the key whose values are compared, and those that it determines
        held = (swept, *others[1:])
        by = others[:1] + tuple(
            k for k in manifest.keys if k not in (*others, swept) and not _follows(settings, k, held)
        )
    baseline = manifest.baseline if set(by) == set(manifest.by) else None
    found = comparison.compare(folder, metric, [key for key in manifest.keys if key in by], baseline)
    here = [settings[number] for number in found.table[campaigns.POINT]]
    places, words = _places([setting.get(swept) for setting in here])
    units = {name: _unit(folder, manifest, name) for name in (swept, *others)}
    lines = _lines(here, places, others, units)
    first = baseline or _label(here[min(lines[0].rows)], others[:1] or (swept,), units)
    return SweepLines(
        found=found,
        key=swept,
        unit=units[swept],
        places=places,
        words=words,
        lines=lines,
        joined=not words and all(_is_ordered(here, line, companions) for line in lines),
        against=first,
    )


def _swept(manifest: Manifest, settings: Sequence[Settings], wanted: str | None) -> str:
    """The key on the axis: numbers before words, many values before few, compared keys last."""
    if wanted is not None and wanted not in manifest.keys:
        raise UsageError(f"{manifest.name} does not vary '{wanted}' ({did_you_mean(wanted, manifest.keys)})")
    if not manifest.keys:
        raise UsageError(f"{manifest.name} has no swept key to plot over")

    def rank(key: str) -> tuple[bool, bool, int]:
        values = {setting[key] for setting in settings if key in setting}
        return key not in manifest.by, all(_is_number(value) for value in values), len(values)

    return wanted or max(manifest.keys, key=rank)


def _others(manifest: Manifest, settings: Sequence[Settings], swept: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(keys that distinguish lines, compared ones first; keys that the swept one determines)."""
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


def _follows(settings: Sequence[Settings], key: str, leaders: Sequence[str]) -> bool:
    """Whether the values of the leaders determine that of the key."""
    known: dict[tuple[Any, ...], Any] = {}
    return all(
        known.setdefault(tuple(setting.get(leader) for leader in leaders), setting.get(key)) == setting.get(key)
        for setting in settings
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _places(values: Sequence[Any]) -> tuple[Floats, tuple[str, ...]]:
    """The places of values on the axis, (rows,), and the words at them if they are not numbers."""
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


def _label(setting: Settings, keys: Iterable[str], units: Mapping[str, str]) -> str:
    """The values of keys as in 'ipf, step 10 s': numbers with their names."""
    return ", ".join(_words(key, setting[key], units[key]) for key in keys if key in setting)


def _words(key: str, value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    name = key.rpartition(".")[2].replace("_", " ")
    return f"{name} {value:g}{f' {unit}' if unit else ''}" if _is_number(value) else f"{name} {value}"


def _is_ordered(here: Sequence[Settings], line: SweepLine, companions: Iterable[str]) -> bool:
    """Whether the numbers determined by the swept key only rise, or only fall, along a line."""
    columns = [pd.Series([here[row].get(key) for row in line.rows]) for key in companions]
    numbers = [column for column in columns if column.map(_is_number).all()]
    return all(each.is_monotonic_increasing or each.is_monotonic_decreasing for each in numbers)


def _unit(folder: Folder, manifest: Manifest, key: str) -> str:
    """The unit of a key of the scenario; empty for a pure number, a word, or a key without description.

    A scenario that needs a plug-in says no unit: what is only shown imports none.
    """
    point = next((point for point in manifest.points if key in point.settings), None)
    if point is None or key == "scenario":
        return ""
    scenario = json.loads(folder.scenario(point.id))
    if refused(scenario, Plugins.NONE):
        return ""
    model: Any = load(scenario, plugins=Plugins.NONE)
    *path, name = key.split(".")
    for word in path:
        model = getattr(model, word, None)
    field = getattr(type(model), "model_fields", {}).get(name)
    unit = UNIT.search(field.description or "") if field else None
    return unit[1] if unit else ""
