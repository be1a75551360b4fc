"""Measures of a variant over its Monte Carlo runs, with 95 % intervals.

    Data(folder): tables, scenarios and bounds by variant
    measured(data, variant, measure) -> Measured;  difference(data, variant, other, measure) -> Measured
    bound_beside(data, variant, measure, kind) -> BoundBeside

A measure is a name:
    rmse                 the time-averaged RMSE over runs (Jiang 2013, eq. 26; Ruan 2020, eq. 10)
    rmse_of_kept         the same over the runs that never lost their target
    column:px            the root mean square error of a state column over steps and runs; column_of_kept:px
    per_run_rmse:px      that over the steps of a run, averaged over the runs (Wei 2022, eq. 17)
    over:VARIANT         `rmse` divided by that of another variant, on the same runs;  less_than:VARIANT, one less that
    mean:energy, median:rmse        over runs, of one of the paper's own measures or of a column of `runs`
    share:lost           the fraction of runs in which a column of `runs` is above zero, with Wilson's interval
    tracks_mean:delay, tracks_median:delay     of a column of `tracks`, over tracks;  tracks:delay, in an order

A paper's own measures are functions (data, variant) -> one value for each run, a Series by replicate; they stand in the
dict MEASURES of the paper's module `measures`.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final, Protocol, TypeAlias, final

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis import campaigns, statistics
from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.errors import did_you_mean
from wsnsim.base.tables import TABLES
from wsnsim.papers.reproduction import BoundBeside, Measured
from wsnsim.recording import attributes
from wsnsim.recording.folder import Folder

OwnMeasure: TypeAlias = "Callable[[Data, str], pd.Series]"
VARIANT: Final = "variant"
OVER_RUNS: Final = ("mean", "median", "tracks_mean", "tracks_median")
COMPARED: Final = ("over", "less_than")
TRUTHS: Final = 100
"""Ground truths that a posterior bound averages over, whatever was run; the most that other bounds use."""
FROM_EVENTS: Final = ("active", "arrived")
ROUNDING: Final = 1e-9
"""Relative difference of two values that are equal but for rounding."""


class MeasuredPaper(Protocol):
    """What `Data` uses of a paper: its published values and its own measures."""

    @property
    def published(self) -> Mapping[str, Any]:
        """The published values, by name."""
        ...

    @property
    def measures(self) -> Mapping[str, OwnMeasure]:
        """The paper's own measures, by name."""
        ...


@final
class Data:
    """The results of one experiment, by variant, and what its paper prints and measures; each table is read once."""

    def __init__(self, folder: Folder, paper: MeasuredPaper | None = None) -> None:
        self.folder = folder
        self.published: Mapping[str, Any] = paper.published if paper else {}
        self.own: Mapping[str, OwnMeasure] = paper.measures if paper else {}
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
        found: dict[str, Any] = json.loads(self.folder.scenario(self.manifest.points[self.variants.index(variant)].id))
        return found

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
        return np.asarray(frame["error"], dtype=np.float64).reshape(tracks, -1)

    def lost(self, variant: str) -> Bools:
        """(replicates,) whether a track was lost at any time, found again or not."""
        return campaigns.ever_lost(self.of(variant, "runs"))

    def of_runs(self, variant: str, column: str) -> pd.Series:
        """A column of the table `runs`, by replicate."""
        return self.of(variant, "runs").set_index("replicate")[column].astype(np.float64)

    def column_errors(self, variant: str, column: str) -> Floats:
        """(replicates x targets, steps) estimate minus truth of a state column; needs `estimates` and `truth`."""
        keys = ["replicate", "target", "step"]
        truth, guess = (self.of(variant, name)[[*keys, column]] for name in ("truth", "estimates"))
        both = guess.merge(truth, on=keys, suffixes=("", "_true")).sort_values(keys)
        tracks = both.groupby(["replicate", "target"]).ngroups
        return np.asarray(both[column] - both[f"{column}_true"], dtype=np.float64).reshape(tracks, -1)


def problem(measure: str, own: Collection[str], variants: Collection[str]) -> str:
    """What is wrong with the name of a measure; '' if nothing is."""
    family, _, rest = measure.partition(":")
    columns = {table: [column.name for column in TABLES[table]] for table in ("runs", "tracks")}
    known: dict[str, Collection[str] | None] = {
        **dict.fromkeys(("rmse", "rmse_of_kept")),
        **{name: [rest] for name in ("column", "column_of_kept", "per_run_rmse")},
        **dict.fromkeys(COMPARED, variants),
        **{name: [*own, *columns["runs"]] for name in ("mean", "median")},
        "share": columns["runs"],
        **dict.fromkeys(("tracks", "tracks_mean", "tracks_median"), columns["tracks"]),
    }
    if family not in known:
        return f"unknown measure '{family}' ({did_you_mean(family, known)})"
    names = known[family]
    return "" if names is None or rest in names else f"{family}: unknown name '{rest}' ({did_you_mean(rest, names)})"


def measured(data: Data, variant: str, measure: str) -> Measured:
    """The value of a measure for a variant, with a bootstrap interval over runs.

    Raises:
        KeyError: no such measure, or the experiment does not record what it needs.
    """
    name, _, column = measure.partition(":")
    lost = data.lost(variant)
    fraction = float(lost.mean()) if len(lost) else float("nan")
    if name == "share":
        found = statistics.share(data.of(variant, "runs")[column].to_numpy() > 0)
        return Measured(found.value, found.low, found.high, len(lost), fraction)
    if name in OVER_RUNS:
        values = _values(data, variant, measure)
        found = (statistics.median if "median" in name else statistics.mean)(values)
        known = int(np.isfinite(values).sum())
        return Measured(found.value, found.low, found.high, min(known, len(lost)), fraction)
    if name == "per_run_rmse":
        found = statistics.mean(_of_runs(data, variant, measure).to_numpy())
        return Measured(found.value, found.low, found.high, len(lost), fraction)
    rows, statistic = _rows(data, variant, name, column)
    count = len(lost)
    if name.endswith("of_kept"):
        rows = rows[~np.repeat(lost, len(rows) // len(lost))]
        count = int(np.count_nonzero(~lost))
    value = statistic(rows) if len(rows) else float("nan")
    low, high = metrics.bootstrap_interval(rows, statistic) if len(rows) else (float("nan"),) * 2
    return Measured(value, low, high, count, fraction)


def bound_beside(data: Data, variant: str, measure: str, kind: str) -> BoundBeside:
    """The bound in the terms of a measure, on the runs that were made; NaN where the measure has none.

    Args:
        data: the results.
        variant: whose bound.
        measure: the measure beside which the bound stands.
        kind: 'unconditional' or 'per_trajectory', see `wsnsim.bounds`; 'active' or 'arrived', conditional on each
            trajectory, for the measurements of active members or those that arrived (of runs that recorded events);
            'variant:NAME', the measured value of a variant that nothing can be better than; or 'own:NAME', the median
            over runs of one of the paper's own measures.
    """
    family, _, rest = kind.partition(":")
    if family == "variant":
        best = measured(data, rest, measure)
        caution = f"the lower end of the measured 95 % interval of '{rest}'"
        return BoundBeside(best.low, f"that of '{rest}'", best.low, caution)
    if family == "own":
        return BoundBeside(measured(data, variant, f"median:{rest}").value, f"{rest.replace('_', ' ')}, not strict")
    if kind in FROM_EVENTS:
        runs = bound_from_events(data, variant, kind)
        return BoundBeside(float(runs.median()), f"{kind}, not strict") if measure == "median:rmse" else BoundBeside()
    found = data.bound(variant, kind)
    value = float("nan") if found.reason else _in_terms(found, measure, data.states(variant))
    if not np.isfinite(value):
        return BoundBeside()
    if kind == "unconditional" and not found.cautions:
        return BoundBeside(value, kind, value)
    return BoundBeside(value, f"{kind}, not strict", caution="; ".join(found.cautions))


def bound_from_events(data: Data, variant: str, readings: str) -> pd.Series:
    """The bound (m) of each run for measurements that were active or arrived; needs events, estimates, clusters."""
    point = data.manifest.points[data.variants.index(variant)]
    found: dict[int, float] = {}
    for batch in data.folder.batches(point.id):
        bound = bounds.bound_of_run(batch.path, readings, "per_trajectory")
        found |= dict(zip(bound.query.replicates, bound.of_replicates.tolist(), strict=True))
    return pd.Series(found)


def computing(data: Data, variant: str) -> pd.Series:
    """The computing time of an estimate (ms): the operations that the tracker states, at the rate of the processor.

    A tracker that is too slow skips steps, which do not count.
    """
    cpu = data.scenario(variant)["cpu"]
    estimates = data.of(variant, "tracks").groupby("replicate")["reports"].sum()
    return 1e3 * data.of_runs(variant, "cycles") / estimates * cpu["cycles_per_flop"] / cpu["rate"]


def _in_terms(found: bounds.Bound, measure: str, states: Sequence[tuple[str, str]]) -> float:
    name, _, column = measure.partition(":")
    if name == "rmse":
        return found.time_mean
    if name == "column":
        index = [state for state, _ in states].index(column)
        return float(np.sqrt(np.mean(found.columns[:, index] ** 2)))
    return float(np.median(found.of_replicates)) if measure == "median:rmse" else float("nan")


def difference(data: Data, variant: str, other: str, measure: str) -> Measured:
    """The median paired difference over runs, `variant` less `other`; of measures that have a value for each run.

    `rmse` is here the RMSE of each run.
    """
    one, two = (_of_runs(data, name, measure) for name in (variant, other))
    common = one.index.intersection(two.index)
    first, second = one[common].to_numpy(dtype=np.float64), two[common].to_numpy(dtype=np.float64)
    found = statistics.paired_difference(
        np.where(np.isclose(first, second, rtol=ROUNDING, atol=0.0), second, first), second
    )
    lost = data.lost(variant) | data.lost(other)
    return Measured(found.value, found.low, found.high, int(np.isfinite(first - second).sum()), float(lost.mean()))


def _values(data: Data, variant: str, measure: str) -> Floats:
    """The values whose mean or median over runs or tracks is taken."""
    name, _, column = measure.partition(":")
    if column in data.own:
        return np.asarray(_of_runs(data, variant, measure), dtype=np.float64)
    table = "tracks" if name.startswith("tracks") else "runs"
    return np.asarray(data.of(variant, table)[column], dtype=np.float64)


def _of_runs(data: Data, variant: str, measure: str) -> pd.Series:
    """One value for each run, by replicate."""
    name, _, column = measure.partition(":")
    if column in data.own:
        return data.own[column](data, variant)
    if name == "per_run_rmse":
        rows = data.column_errors(variant, column)
        runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
        return pd.Series([metrics.rmse(row) for row in rows.reshape(len(runs), -1)], index=runs)
    table = data.of(variant, "tracks" if name.startswith("tracks") else "runs")
    values = table.set_index("replicate")[column or "rmse"].astype(np.float64)
    return values.groupby(level=0).mean()


def _rows(data: Data, variant: str, name: str, column: str) -> tuple[Floats, Callable[[Floats], float]]:
    """(one row for each track, the statistic over them)."""
    if name in ("rmse", "rmse_of_kept"):
        return data.errors(variant), metrics.time_mean_rmse
    if name in ("column", "column_of_kept"):
        return data.column_errors(variant, column), metrics.rmse
    if name in COMPARED:
        return np.hstack([data.errors(variant), data.errors(column)]), _over if name == "over" else _share_less
    raise KeyError(f"no measure is called '{name}'")


def _over(rows: Floats) -> float:
    """The ratio a / b, where a and b are the time-averaged RMSE of two variants whose errors stand side by side."""
    one, other = (metrics.time_mean_rmse(half) for half in np.hsplit(rows, 2))
    return one / other


def _share_less(rows: Floats) -> float:
    """1 - a / b."""
    return 1.0 - _over(rows)
