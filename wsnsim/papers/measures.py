"""Measures of a variant over its Monte Carlo runs, with 95 % intervals.

    Data(folder): tables, scenarios and bounds by variant
    measured(data, variant, measure) -> Measured        sample(data, variant, measure) -> Sample
    difference(data, variant, other, measure) -> Sample

A measure is a name:
    rmse                 the time-averaged RMSE over runs (Jiang 2013, eq. 26; Ruan 2020, eq. 10)
    rmse_of_kept         the same over the runs that never lost their target
    column:px            the root mean square error of a state column over steps and runs; column_of_kept:px
    per_run_rmse:px      that over the steps of a run, averaged over the runs (Wei 2022, eq. 17)
    over:VARIANT         `rmse` divided by that of another variant, on the same runs;  less_than:VARIANT, one less that
    over:VARIANT; mean:energy       the same of another measure
    mean:energy, median:rmse        over runs, of one of the study's own measures or of a column of `runs`
    share:lost           the fraction of runs in which a column of `runs` is above zero, with Wilson's interval
    tracks_mean:delay, tracks_median:delay     of a column of `tracks`, over tracks;  tracks:delay is tracks_mean:delay

A study's own measures are functions (data, variant) -> one value for each run, a Series by replicate; they stand in the
mapping MEASURES of its `study.py`.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias, final

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis import campaigns, statistics
from wsnsim.analysis.quantities import loss_rule
from wsnsim.base.arrays import Bools, Floats
from wsnsim.papers.reproduction import COMPARED, OF_ANOTHER, Claim, Losses, Measured
from wsnsim.papers.resampling import (
    MEAN,
    MEDIAN,
    PER_RUN_RMSE,
    POOLED_RMSE,
    SHARE,
    TIME_MEAN_RMSE,
    TRACKS_MEAN,
    TRACKS_MEDIAN,
    Sample,
    compared,
    known,
    value,
)
from wsnsim.papers.study import Study
from wsnsim.papers.verdicts import PublishedValue, interval
from wsnsim.recording import attributes
from wsnsim.recording.folder import Folder
from wsnsim.scenario import Plugins, load

OwnMeasure: TypeAlias = "Callable[[Data, str], pd.Series]"
VARIANT: Final = "variant"
TRUTHS: Final = 100
"""Ground truths that a posterior bound averages over, whatever was run; the most that other bounds use."""
ROUNDING: Final = 1e-9
"""Relative difference of two values that are equal but for rounding."""
OVER_RUNS: Final = {"mean": MEAN, "median": MEDIAN, "share": SHARE, "tracks_mean": TRACKS_MEAN,
                    "tracks_median": TRACKS_MEDIAN, "tracks": TRACKS_MEAN}  # fmt: skip
OF_ERRORS: Final = {"rmse": TIME_MEAN_RMSE, "rmse_of_kept": TIME_MEAN_RMSE, "column": POOLED_RMSE,
                    "column_of_kept": POOLED_RMSE, "per_run_rmse": PER_RUN_RMSE}  # fmt: skip
RATIOS: Final[Mapping[str, tuple[Callable[[Floats, Floats], Floats], str]]] = {
    "over": (lambda one, other: one / other, "ratio"),
    "less_than": (lambda one, other: 1.0 - one / other, "one less the ratio"),
}


@final
class Data:
    """The results of an experiment, by variant, and what its study prints, registers and measures."""

    def __init__(self, folder: Folder, study: Study | None = None) -> None:
        self.folder = folder
        self.published: Mapping[str, Any] = study.published if study else {}
        self.registered: Mapping[str, Any] = study.registered if study else {}
        self.own: Mapping[str, OwnMeasure] = study.measures if study else {}
        self.manifest = folder.manifest()
        self.variants = tuple(str(point.settings[VARIANT]) for point in self.manifest.points)
        self.table = functools.cache(self._table)
        self.errors = functools.cache(self._errors)
        self.column_errors = functools.cache(self._column_errors)
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
            self.bounds[key] = bounds.bound(
                load(self.scenario(variant), plugins=Plugins.NONE), range(runs), kind, gains
            )
        return self.bounds[key]

    def loss_rule(self, variant: str) -> str:
        """When a track of a variant is lost, in words."""
        return loss_rule(dict(self.of(variant, "runs")), next((unit for _, unit in self.states(variant)), ""))

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

    def _column_errors(self, variant: str, column: str) -> Floats:
        """(replicates x targets, steps) estimate minus truth of a state column; needs `estimates` and `truth`."""
        keys = ["replicate", "target", "step"]
        truth, guess = (self.of(variant, name)[[*keys, column]] for name in ("truth", "estimates"))
        both = guess.merge(truth, on=keys, suffixes=("", "_true")).sort_values(keys)
        tracks = both.groupby(["replicate", "target"]).ngroups
        return np.asarray(both[column] - both[f"{column}_true"], dtype=np.float64).reshape(tracks, -1)


def measured(data: Data, variant: str, measure: str) -> Measured:
    """The value of a measure for a variant, with a 95 % interval over runs.

    Raises:
        KeyError: no such measure, or the experiment does not record what it needs.
    """
    name, _, column = measure.partition(":")
    found = sample(data, variant, measure)
    lost = data.lost(variant)
    fraction = float(lost.mean()) if len(lost) else float("nan")
    count = len(known(found).runs)
    if name == "share":
        flags = statistics.share(data.of(variant, "runs")[column].to_numpy() > 0)
        return Measured(flags.value, flags.low, flags.high, count, fraction)
    if name in OVER_RUNS:
        of = statistics.median if "median" in name else statistics.mean
        estimate = of(found.rows.ravel().astype(np.float64))
        return Measured(estimate.value, estimate.low, estimate.high, count, fraction)
    return Measured(value(found), *interval(found), count, fraction)


def sample(data: Data, variant: str, measure: str) -> Sample:
    """A measure of a variant as a statistic over its runs, which can be resampled.

    Raises:
        KeyError: no such measure, or the experiment does not record what it needs.
    """
    name, _, column = measure.partition(":")
    if name in COMPARED:
        rival, _, of_both = column.partition(OF_ANOTHER)
        one, other = (known(sample(data, each, of_both or "rmse")) for each in (variant, rival))
        return compared(one, other, *RATIOS[name])
    if name in OF_ERRORS:
        runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
        errors = data.column_errors(variant, column) if column else data.errors(variant)
        rows = errors.reshape(len(runs), -1, errors.shape[-1])
        kept = ~data.lost(variant) if name.endswith("of_kept") else np.ones(len(runs), dtype=np.bool_)
        return Sample(runs[kept], rows[kept], OF_ERRORS[name])
    if name not in OVER_RUNS:
        raise KeyError(f"no measure is called '{name}'")
    return _sample_of_values(data, variant, measure)


def _sample_of_values(data: Data, variant: str, measure: str) -> Sample:
    """A statistic over the values of a column, or of one of the study's own measures."""
    name, _, column = measure.partition(":")
    if column in data.own:
        found = data.own[column](data, variant)
        return Sample(found.index.to_numpy(), found.to_numpy(dtype=np.float64)[:, None], OVER_RUNS[name])
    frame = data.of(variant, "tracks" if name.startswith("tracks") else "runs")
    frame = frame.assign(track=frame.groupby("replicate").cumcount())
    rows = frame.pivot(index="replicate", columns="track", values=column).astype(np.float64)
    flags = rows > 0.0 if name == "share" else rows
    return Sample(rows.index.to_numpy(), flags.to_numpy(dtype=np.float64), OVER_RUNS[name])


def difference(data: Data, variant: str, other: str, measure: str) -> Sample:
    """The measure of a variant less that of another, on the same runs. Equal but for rounding counts as equal."""
    one, two = (known(sample(data, name, measure)) for name in (variant, other))
    return compared(one, two, _less, "difference")


def judged_terms(data: Data, claim: Claim) -> tuple[Sample, PublishedValue]:
    """The statistic by which a published value is judged, and the value in its terms: a ratio for a share less."""
    assert claim.published is not None
    family, _, rest = claim.measure.partition(":")
    less = family == "less_than"
    found = known(sample(data, claim.variant, f"over:{rest}" if less else claim.measure))
    printed = 1.0 - claim.published if less else claim.published
    return found, PublishedValue(
        printed, claim.published_runs, claim.deterministic, claim.fraction, rivals=family in COMPARED
    )


def losses(data: Data, variant: str) -> Losses:
    """What the runs of a variant lost and found again."""
    tracks, runs = data.of(variant, "tracks"), data.of(variant, "runs")
    reacquired = tracks.groupby("replicate")["reacquired"].sum()
    lost, seconds = float(runs["losses"].mean()), float(runs["time_lost"].mean())
    return Losses(float(reacquired.mean()), lost, seconds, data.loss_rule(variant))


def _less(one: Floats, other: Floats) -> Floats:
    return np.where(np.isclose(one, other, rtol=ROUNDING, atol=0.0), 0.0, one - other)


def computing(data: Data, variant: str) -> pd.Series:
    """The computing time of an estimate (ms): the operations that the tracker states, at the rate of the processor.

    A tracker that is too slow skips steps, which do not count.
    """
    cpu = data.scenario(variant)["cpu"]
    estimates = data.of(variant, "tracks").groupby("replicate")["reports"].sum()
    return 1e3 * data.of_runs(variant, "cycles") / estimates * cpu["cycles_per_flop"] / cpu["rate"]
