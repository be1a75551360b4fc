"""What is measured of a variant, over its replicates.

    Data(folder): tables, scenarios and bounds by variant
    measured(data, variant, measure) -> Measured;  difference(data, variant, other, measure) -> Measured
    bound_of(data, variant, measure, kind) -> Limit

A measure is a name:
    rmse                 the time mean of the RMSE over runs at each step (Jiang 2013, eq. 26; Ruan 2020, eq. 10)
    rmse_of_kept         the same over the runs that kept their target
    column:px            the root mean square error of a state column over steps and runs; column_of_kept:px
    over:VARIANT         `rmse` over that of another variant, on the same runs;  less_than:VARIANT, one less that
    mean:energy, median:rmse        of a column of `runs` over runs
    share:lost           the share of runs in which a column of `runs` is above zero, with Wilson's interval
    tracks_mean:delay, tracks_median:delay     of a column of `tracks` over tracks
    mean_of:module:function, median_of:module:function     over runs, of what a paper's own function (data, variant)
                         gives: a figure a run, a Series by replicate
"""

from __future__ import annotations

import functools
import importlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis import campaigns, statistics
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.reproduction import Limit, Measured
from wsnsim.recording import attributes
from wsnsim.recording.folder import Folder

VARIANT = "variant"
OF_RUNS = ("mean", "median", "tracks_mean", "tracks_median", "mean_of", "median_of")
TRUTHS = 100
"""Truths that an unconditional bound is the mean over, whatever was run; the most that others look at."""
OF_LOG = ("active", "arrived")
ALIKE = 1e-9
"""Share of their level by which two figures may differ and still be equal: what rounding leaves."""


@final
class Data:
    """The results of one experiment, by variant; each table is read once."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.manifest = folder.manifest()
        self.variants = tuple(str(point.settings[VARIANT]) for point in self.manifest.points)
        self.table = functools.cache(self._table)
        self.errors = functools.cache(self._errors)
        self.scenario = functools.cache(self._scenario)
        self.bound = functools.cache(self._bound)
        self.bounds: dict[tuple[str, int, str, str], bounds.Bound] = {}

    def of(self, variant: str, table: str) -> pd.DataFrame:
        """The rows of one variant."""
        frame = self.table(table)
        return frame[frame[VARIANT] == variant]

    def _table(self, table: str) -> pd.DataFrame:
        return campaigns.read(self.folder.path, table)

    def _scenario(self, variant: str) -> Mapping[str, Any]:
        return json.loads(self.folder.scenario(self.manifest.points[self.variants.index(variant)].id))

    def _bound(self, variant: str, kind: str) -> bounds.Bound:
        point = self.manifest.points[self.variants.index(variant)]
        runs = TRUTHS if kind == "unconditional" else min(point.replicates, TRUTHS)
        assumes = self.scenario(variant)["tracker"].get("assumes") or {}
        gains = "known" if kind == "unconditional" else assumes.get("gains", "known")
        key = point.world, runs, kind, gains
        if key not in self.bounds:
            self.bounds[key] = bounds.bound(self.scenario(variant), range(runs), kind, gains)
        return self.bounds[key]

    def states(self, variant: str) -> tuple[tuple[str, str], ...]:
        """(name, unit) of the state columns."""
        point = self.manifest.points[self.variants.index(variant)]
        found: tuple[tuple[str, str], ...] = attributes(self.folder.batches(point.id)[0].path)["states"]
        return found

    def _errors(self, variant: str) -> Floats:
        """(replicates x targets, steps) position errors; needs the table `estimates`."""
        frame = self.of(variant, "estimates").sort_values(["replicate", "target", "step"])
        tracks = frame.groupby(["replicate", "target"]).ngroups
        return frame["error"].to_numpy(dtype=np.float64).reshape(tracks, -1)

    def lost(self, variant: str) -> np.ndarray:
        """(replicates,) whether a track was lost."""
        return self.of(variant, "runs")["lost"].to_numpy() > 0

    def column_errors(self, variant: str, column: str) -> Floats:
        """(replicates x targets, steps) estimate minus truth of a state column; needs `estimates` and `truth`."""
        keys = ["replicate", "target", "step"]
        truth, guess = (self.of(variant, name)[[*keys, column]] for name in ("truth", "estimates"))
        both = guess.merge(truth, on=keys, suffixes=("", "_true")).sort_values(keys)
        tracks = both.groupby(["replicate", "target"]).ngroups
        return (both[column] - both[f"{column}_true"]).to_numpy(dtype=np.float64).reshape(tracks, -1)


def measured(data: Data, variant: str, measure: str) -> Measured:
    """A measure of a variant, its interval by the bootstrap over replicates.

    Raises:
        KeyError: no such measure, or the experiment does not record what it needs.
    """
    name, _, column = measure.partition(":")
    lost = data.lost(variant)
    share = float(lost.mean()) if len(lost) else float("nan")
    if name == "share":
        found = statistics.share(data.of(variant, "runs")[column].to_numpy() > 0)
        return Measured(found.value, found.low, found.high, len(lost), share)
    if name in OF_RUNS:
        values = _values(data, variant, measure)
        found = (statistics.median if "median" in name else statistics.mean)(values)
        known = int(np.isfinite(values).sum())
        return Measured(found.value, found.low, found.high, min(known, len(lost)), share)
    rows, statistic = _rows(data, variant, name, column)
    count = len(lost)
    if name.endswith("of_kept"):
        rows = rows[~np.repeat(lost, len(rows) // len(lost))]
        count = int(np.count_nonzero(~lost))
    value = statistic(rows) if len(rows) else float("nan")
    low, high = metrics.bootstrap_interval(rows, statistic) if len(rows) else (float("nan"),) * 2
    return Measured(value, low, high, count, share)


def bound_of(data: Data, variant: str, measure: str, kind: str) -> Limit:
    """The bound in the terms of a measure, on the replicates that were run; not a number where there is none for it.

    `kind` is unconditional or per_trajectory (see `bounds.crlb`); active or arrived, along each truth for the
    readings of active members, and for those that arrived, of runs that recorded their events; 'variant:NAME', what a
    variant measures that nothing can be better than; or 'own:MODULE:FUNCTION', the median over runs of what a paper's
    own function gives.
    """
    family, _, rest = kind.partition(":")
    if family == "variant":
        best = measured(data, rest, measure)
        counts = f"the lower end of the 95 % interval of what '{rest}' measures"
        return Limit(best.low, f"that of '{rest}'", best.low, counts)
    if family == "own":
        own = measured(data, variant, f"median_of:{rest}")
        return Limit(own.value, f"{rest.rpartition(':')[2].replace('_', ' ')}, not strict")
    if kind in OF_LOG:
        runs = of_log(data, variant, kind)
        return Limit(float(runs.median()), f"{kind}, not strict") if measure == "median:rmse" else Limit()
    found = data.bound(variant, kind)
    value = float("nan") if found.reason else _in_terms(found, measure, data.states(variant))
    if not np.isfinite(value):
        return Limit()
    if kind == "unconditional" and not found.cautions:
        return Limit(value, kind, value)
    return Limit(value, f"{kind}, not strict", caution="; ".join(found.cautions))


def of_log(data: Data, variant: str, readings: str) -> pd.Series:
    """The bound along each run's truth for readings that were active or arrived; needs events, estimates, clusters."""
    point = data.manifest.points[data.variants.index(variant)]
    found: dict[int, float] = {}
    for batch in data.folder.batches(point.id):
        bound = bounds.bound_of_run(batch.path, readings, "per_trajectory")
        found |= dict(zip(bound.query.replicates, bound.of_replicates.tolist(), strict=True))
    return pd.Series(found)


def _in_terms(found: bounds.Bound, measure: str, states: Sequence[tuple[str, str]]) -> float:
    name, _, column = measure.partition(":")
    if name == "rmse":
        return found.time_mean
    if name == "column":
        index = [state for state, _ in states].index(column)
        return float(np.sqrt(np.mean(found.columns[:, index] ** 2)))
    return float(np.median(found.of_replicates)) if measure == "median:rmse" else float("nan")


def difference(data: Data, variant: str, other: str, measure: str) -> Measured:
    """The median over replicates of what a variant has more than another, pair by pair; measures of single runs only.

    `rmse` is each run's own here.
    """
    one, two = (_of_runs(data, name, measure) for name in (variant, other))
    common = one.index.intersection(two.index)
    first, second = one[common].to_numpy(dtype=np.float64), two[common].to_numpy(dtype=np.float64)
    found = statistics.paired_difference(
        np.where(np.isclose(first, second, rtol=ALIKE, atol=0.0), second, first), second
    )
    lost = data.lost(variant) | data.lost(other)
    return Measured(found.value, found.low, found.high, int(np.isfinite(first - second).sum()), float(lost.mean()))


def _values(data: Data, variant: str, measure: str) -> Floats:
    """The figures that a mean or a median over runs or tracks is of."""
    name, _, column = measure.partition(":")
    if name.endswith("_of"):
        return _of_runs(data, variant, measure).to_numpy(dtype=np.float64)
    return data.of(variant, "tracks" if name.startswith("tracks") else "runs")[column].to_numpy(dtype=np.float64)


def _of_runs(data: Data, variant: str, measure: str) -> pd.Series:
    """A figure a replicate."""
    name, _, column = measure.partition(":")
    if name in ("mean_of", "median_of"):
        module, _, function = column.partition(":")
        own: pd.Series = getattr(importlib.import_module(module), function)(data, variant)
        return own
    table = data.of(variant, "tracks" if name.startswith("tracks") else "runs")
    values = table.set_index("replicate")[column or "rmse"].astype(np.float64)
    return values.groupby(level=0).mean()


def _rows(data: Data, variant: str, name: str, column: str) -> tuple[Floats, Callable[[Floats], float]]:
    """(a row a track, the statistic over them)."""
    if name in ("rmse", "rmse_of_kept"):
        return data.errors(variant), metrics.time_mean_rmse
    if name in ("column", "column_of_kept"):
        return data.column_errors(variant, column), metrics.rmse
    if name in ("over", "less_than"):
        return np.hstack([data.errors(variant), data.errors(column)]), _over if name == "over" else _share_less
    raise KeyError(f"no measure is called '{name}'")


def _over(rows: Floats) -> float:
    """a / b, of the time means a and b of two variants whose errors stand side by side."""
    one, other = (metrics.time_mean_rmse(half) for half in np.hsplit(rows, 2))
    return one / other


def _share_less(rows: Floats) -> float:
    """1 - a / b."""
    return 1.0 - _over(rows)
