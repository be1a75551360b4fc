"""Figures over columns: how far off, how often lost. A step without an estimate has error NaN.

errors: (steps,) of one replicate, or (replicates, steps)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints

ENOUGH_READINGS = 3
"""Ranges that fix a position in the plane without a guess."""
LOST_WINDOW = 100
LOST_ERROR = 20.0


def rmse(errors: Floats) -> float:
    """Root mean square over the steps that have an estimate; NaN if none has."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def median_error(errors: Floats) -> float:
    """The median over the steps that have an estimate; NaN if none has."""
    known = errors[np.isfinite(errors)]
    return float(np.median(known)) if known.size else float("nan")


def is_lost(errors: Floats, window: int = LOST_WINDOW, limit: float = LOST_ERROR) -> bool:
    """Whether a track is lost: the mean error of its last `window` steps exceeds `limit` metres.

    So is one that has no estimate for half of them. The 100 steps and 20 m are our choice; Jiang (2013) gives no rule.
    """
    last = errors[-window:]
    known = last[np.isfinite(last)]
    return bool(known.size * 2 <= last.size or np.mean(known) > limit)


def first_lost(errors: Floats, window: int = LOST_WINDOW, limit: float = LOST_ERROR) -> float:
    """The first step (counted from 1) that ends a window by which the track `is_lost`; NaN if none does."""
    window = min(window, errors.size)
    known = np.isfinite(errors)
    counts, sums = (np.concatenate(([0.0], np.cumsum(x))) for x in (known, np.where(known, errors, 0.0)))
    seen, total = counts[window:] - counts[:-window], sums[window:] - sums[:-window]
    bad = (seen * 2 <= window) | (total > limit * seen)
    return float(window + np.argmax(bad)) if bad.any() else float("nan")


def per_step_rmse(errors: Floats) -> Floats:
    """(steps,) root mean square over replicates at each step (Jiang 2013, eq. 26); NaN where none has an estimate."""
    known = np.isfinite(errors)
    count = known.sum(axis=0)
    square = np.where(known, errors, 0.0) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Floats = np.sqrt(square.sum(axis=0) / count)
        return result


def time_mean_rmse(errors: Floats) -> float:
    """The time mean of the per-step RMSE over replicates: the figure that Jiang (2013) publishes."""
    steps = per_step_rmse(np.atleast_2d(errors))
    known = steps[np.isfinite(steps)]
    return float(known.mean()) if known.size else float("nan")


def lost_fraction(lost: Bools) -> float:
    """The fraction of tracks that were lost."""
    return float(np.mean(lost)) if len(lost) else float("nan")


def bootstrap_interval(
    errors: Floats, statistic: Callable[[Floats], float], draws: int = 400, confidence: float = 0.95
) -> tuple[float, float]:
    """The percentile bootstrap interval of a statistic over the rows of `errors`; NaN with fewer than five rows."""
    count = len(errors)
    if count < 5:
        return float("nan"), float("nan")
    rng = np.random.Generator(np.random.Philox(count))
    values = [statistic(errors[rng.integers(0, count, count)]) for _ in range(draws)]
    tail = (1.0 - confidence) / 2.0
    low, high = np.nanquantile(values, [tail, 1.0 - tail])
    return float(low), float(high)


def tracked_share(issued: Floats, times: Floats, readings: Ints, dt: float, least: int) -> float:
    """The share of steps whose estimate was issued before the next step, and rests on `least` readings or more."""
    in_time = np.isfinite(issued) & (issued <= times + dt)
    return float(np.mean(in_time & (readings >= least))) if len(times) else float("nan")


def mean_error(errors: Floats) -> float:
    """The mean over the steps that have an estimate; NaN if none has."""
    known = errors[np.isfinite(errors)]
    return float(known.mean()) if known.size else float("nan")
