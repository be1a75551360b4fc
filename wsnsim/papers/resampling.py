"""Statistics over Monte Carlo runs as functions of the runs' weights, for a bootstrap over runs.

    weights(of, size) -> (DRAWS, of)                how often each of `of` runs is drawn in resamples of `size` runs
    Sample(runs, rows, MEAN).at(weights)            the statistic of each resample
    compared(one, other, ratio, "ratio").at(weights)  the same of two samples of the same runs, resampled together

Equal numbers of runs give equal weights, so that everything compared is resampled alike. The runs of a sample may have
several tracks, of which a resample takes all or none. Unknown values (NaN) are left out; a statistic of nothing is NaN.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from wsnsim.base.arrays import Floats, Ints

DRAWS: Final = 1000
NAN: Final = float("nan")


@dataclass(frozen=True)
class Statistic:
    """A statistic over runs.

    Attributes:
        words: the statistic in words.
        weighted: the function (rows, weights) -> (draws, ...).
        per_run: the function rows -> (n, ...): the value of each run by itself.
        robust: whether a few runs cannot move it far.
    """

    words: str
    weighted: Callable[[Any, Floats], Floats]
    per_run: Callable[[Any], Floats]
    robust: bool = False


@final
@dataclass(frozen=True)
class Sample:
    """The values of runs, and a statistic over them.

    Attributes:
        runs: (n,) the numbers of the runs.
        rows: (n, ...) their values, see the statistics below.
        statistic: what is taken over them.
    """

    runs: Ints
    rows: Floats | Ints
    statistic: Statistic

    @property
    def per_run(self) -> Floats:
        """(n,) the value of each run by itself."""
        return self.statistic.per_run(self.rows)

    def at(self, weights: Floats) -> Floats:
        """(draws, ...) the statistic of runs with these weights (draws, n)."""
        return self.statistic.weighted(self.rows, weights)

    def among(self, runs: Ints) -> Sample:
        """The same over some of the runs."""
        kept = np.isin(self.runs, runs)
        return self if kept.all() else Sample(self.runs[kept], self.rows[kept], self.statistic)


def compared(one: Sample, other: Sample, combine: Callable[[Floats, Floats], Floats], word: str) -> Sample:
    """What is computed from two statistics of the same runs, over those that both have: a ratio or a difference.

    Args:
        one: the one statistic.
        other: the other statistic.
        combine: the function of both.
        word: what it gives, in words.
    """
    common = np.intersect1d(one.runs, other.runs)

    def combined(of: Callable[[Sample], Floats], places: Ints) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            return combine(of(one.among(common[places])), of(other.among(common[places])))

    statistic = Statistic(
        f"{word} of two: {one.statistic.words}",
        lambda places, weights: combined(lambda sample: sample.at(weights), places),
        lambda places: combined(lambda sample: sample.per_run, places),
        one.statistic.robust and other.statistic.robust,
    )
    return Sample(common, np.arange(len(common)), statistic)


@functools.lru_cache(maxsize=8)
def weights(of: int, size: int, published: bool = False) -> Floats:
    """(DRAWS, of) how often each of `of` runs is drawn in resamples of `size` runs with replacement.

    Those that stand for the published runs are independent of the others. Without runs nothing is drawn.
    """
    rng = np.random.Generator(np.random.Philox(key=[2 * of + published, size]))
    drawn = rng.multinomial(size, np.full(of, 1.0 / of), size=DRAWS).astype(np.float64) if of else np.empty((DRAWS, 0))
    drawn.flags.writeable = False
    return drawn


def value(sample: Sample) -> float:
    """The statistic of the runs as they are; NaN without runs."""
    return float(sample.at(np.ones((1, len(sample.runs))))[0])


def known(sample: Sample) -> Sample:
    """The same over the runs that have a value."""
    return sample.among(sample.runs[np.isfinite(sample.per_run)])


def median_of_runs(sample: Sample) -> Sample:
    """The median over the runs of the values that they have by themselves."""
    return Sample(sample.runs, sample.per_run[:, None], MEDIAN_OF_RUNS)


def _sums(values: Floats) -> tuple[Floats, Floats]:
    """(n, ...) sums over the second axis, and the number of known values behind them, which broadcasts to the sums."""
    known = np.isfinite(values)
    if known.all():
        return values.sum(axis=1), np.full((len(values), *[1] * (values.ndim - 2)), float(values.shape[1]))
    return np.where(known, values, 0.0).sum(axis=1), known.sum(axis=1).astype(np.float64)


def _over(sums: Floats, counts: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return sums / counts


def _weighted(weights: Floats, values: Floats) -> Floats:
    """(draws, ...) sums of (n, ...) values with the weights of the runs."""
    return np.tensordot(weights, values, axes=1)


def _mean(rows: Floats, weights: Floats) -> Floats:
    sums, counts = _sums(rows)
    return _over(_weighted(weights, sums), _weighted(weights, counts))


def _mean_of_each(rows: Floats) -> Floats:
    return _over(*_sums(rows))


def _median(rows: Floats, weights: Floats) -> Floats:
    """(draws,) the median over the tracks of all runs."""
    values = rows.ravel()
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    if not order.size:
        return np.full(len(weights), NAN)
    cumulated = np.cumsum(weights[:, order // rows.shape[1]], axis=1)
    half = cumulated[:, -1:] / 2.0
    lower, upper = (np.argmax(mask, axis=1) for mask in (cumulated >= half, cumulated > half))
    found: Floats = (values[order[lower]] + values[order[upper]]) / 2.0
    return np.where(cumulated[:, -1] > 0.0, found, NAN)


def _median_of_each(rows: Floats) -> Floats:
    known = np.isfinite(rows).any(axis=1)
    found = np.full(len(rows), NAN)
    found[known] = np.nanmedian(rows[known], axis=1)
    return found


def _time_mean_rmse(rows: Floats, weights: Floats) -> Floats:
    squares, counts = _sums(rows**2)
    steps: Floats = np.sqrt(_over(_weighted(weights, squares), _weighted(weights, counts)))
    return _over(*_sums(steps))


def _pooled_rmse(rows: Floats, weights: Floats) -> Floats:
    squares, counts = _sums(_steps_in_line(rows**2))
    return np.sqrt(_over(_weighted(weights, squares), _weighted(weights, counts)))


def _rmse_of_each(rows: Floats) -> Floats:
    return np.sqrt(_over(*_sums(_steps_in_line(rows**2))))


def _steps_in_line(rows: Floats) -> Floats:
    """(n, targets x steps, ...) rows with targets and steps on one axis."""
    return rows.reshape(len(rows), rows.shape[1] * rows.shape[2], *rows.shape[3:])


MEAN: Final = Statistic("mean over runs", _mean, _mean_of_each)
"""Of rows (n, tracks)."""
SHARE: Final = Statistic("share of runs", _mean, _mean_of_each)
"""Of rows (n, 1) that are 0 or 1."""
MEDIAN: Final = Statistic("median over runs", _median, _median_of_each, robust=True)
"""Of rows (n, tracks)."""
MEDIAN_OF_RUNS: Final = Statistic(
    "median of the runs, of a difference paired by run", _median, _median_of_each, robust=True
)
TRACKS_MEAN: Final = Statistic("mean over tracks", _mean, _mean_of_each)
TRACKS_MEDIAN: Final = Statistic("median over tracks", _median, _median_of_each, robust=True)
TIME_MEAN_RMSE: Final = Statistic("RMSE over runs, mean over steps", _time_mean_rmse, _rmse_of_each)
"""Of rows (n, targets, steps)."""
POOLED_RMSE: Final = Statistic("RMSE over runs and steps", _pooled_rmse, _rmse_of_each)
"""Of rows (n, targets, steps)."""
PER_RUN_RMSE: Final = Statistic(
    "RMSE of a run, mean over runs", lambda rows, w: _mean(_rmse_of_each(rows)[:, None], w), _rmse_of_each
)
"""Of rows (n, targets, steps)."""
