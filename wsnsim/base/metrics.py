"""Error and loss metrics of tracks. The error of a step without an estimate is NaN.

errors: (steps,) of one run, or (runs, steps)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints

ENOUGH_READINGS = 3
"""Number of ranges that determine a position in the plane."""
LEAST_EIGENVALUE = 1e-12
"""A correlation matrix with an eigenvalue below this counts as singular: rounding makes 1e-16 (our choice)."""
LOST_WINDOW = 100
LOST_ERROR = 20.0


def rmse(errors: Floats) -> float:
    """Root mean square error over the steps with an estimate; NaN without one."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def median_error(errors: Floats) -> float:
    """Median error over the steps with an estimate; NaN without one."""
    known = errors[np.isfinite(errors)]
    return float(np.median(known)) if known.size else float("nan")


def is_lost(errors: Floats, window: int = LOST_WINDOW, limit: float = LOST_ERROR) -> bool:
    """Whether a track is lost: the mean error of its last `window` steps exceeds `limit` metres.

    A track without an estimate at half of these steps is lost, too. The defaults of 100 steps and 20 m are our choice;
    Jiang (2013) gives no rule.
    """
    last = errors[-window:]
    known = last[np.isfinite(last)]
    return bool(known.size * 2 <= last.size or np.mean(known) > limit)


def first_lost(errors: Floats, window: int = LOST_WINDOW, limit: float = LOST_ERROR) -> float:
    """The last step (from 1) of the first window in which the track `is_lost`; NaN if there is none."""
    lost, _ = _windows(errors, window, limit)
    return float(min(window, errors.size) + np.argmax(lost)) if lost.any() else float("nan")


def lost_steps(errors: Floats, window: int = LOST_WINDOW, limit: float = LOST_ERROR) -> Bools:
    """(steps,) whether the track is lost at each step, of the errors (steps,) of one track.

    A loss begins at the last step of a window in which the track `is_lost`. It ends, with hysteresis, at the last step
    of a window that has estimates at more than half of its steps and a mean error of at most half of `limit`; so an
    error that wavers about the limit is one loss. The steps of the first window share the state at its end. The rule
    is our choice: the papers give none.
    """
    lost, found = _windows(errors, window, limit)
    if not lost.any():
        return np.zeros(errors.shape, dtype=np.bool_)
    latest = np.maximum.accumulate(np.where(lost | found, np.arange(lost.size), -1))
    state = (latest >= 0) & lost[latest]
    return np.concatenate([np.full(errors.size - state.size, state[0]), state])


def count_losses(lost: Bools) -> int:
    """The number of losses of one track, of `lost_steps`: uninterrupted stretches of lost steps."""
    return int(np.count_nonzero(lost[1:] & ~lost[:-1])) + int(lost[:1].any())


def _windows(errors: Floats, window: int, limit: float) -> tuple[Bools, Bools]:
    """(steps − window + 1,) whether the track is lost in each window, and whether it is surely found there."""
    window = min(window, errors.size)
    known = np.isfinite(errors)
    # An error above limit * window decides on its window alone; larger ones would only cost the sums their precision.
    bounded = np.minimum(np.where(known, errors, 0.0), 2.0 * limit * window)
    counts, sums = (np.concatenate(([0.0], np.cumsum(x))) for x in (known, bounded))
    seen, total = counts[window:] - counts[:-window], sums[window:] - sums[:-window]
    few, most = seen * 2 <= window, limit * np.maximum(seen, 1.0)
    return few | (total > most), ~few & (total <= 0.5 * most)


def per_step_rmse(errors: Floats) -> Floats:
    """(steps,) RMSE over the runs at each step (Jiang 2013, eq. 26); NaN where no run has an estimate."""
    known = np.isfinite(errors)
    count = known.sum(axis=0)
    square = np.where(known, errors, 0.0) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Floats = np.sqrt(square.sum(axis=0) / count)
        return result


def time_mean_rmse(errors: Floats) -> float:
    """The time-averaged RMSE (over runs), which Jiang (2013) publishes."""
    steps = per_step_rmse(np.atleast_2d(errors))
    known = steps[np.isfinite(steps)]
    return float(known.mean()) if known.size else float("nan")


def lost_fraction(lost: Bools) -> float:
    """Fraction of tracks that were lost."""
    return float(np.mean(lost)) if len(lost) else float("nan")


def bootstrap_interval(
    errors: Floats, statistic: Callable[[Floats], float], draws: int = 400, confidence: float = 0.95
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic over the rows of `errors`; NaN with fewer than five rows."""
    count = len(errors)
    if count < 5:
        return float("nan"), float("nan")
    rng = np.random.Generator(np.random.Philox(count))
    values = [statistic(errors[rng.integers(0, count, count)]) for _ in range(draws)]
    tail = (1.0 - confidence) / 2.0
    low, high = np.nanquantile(values, [tail, 1.0 - tail])
    return float(low), float(high)


def tracked_share(issued: Floats, times: Floats, readings: Ints, dt: float, least: int) -> float:
    """Share of steps whose estimate was issued before the next step, from at least `least` measurements."""
    in_time = np.isfinite(issued) & (issued <= times + dt)
    return float(np.mean(in_time & (readings >= least))) if len(times) else float("nan")


def normalised_squares(deviations: Floats, covs: Floats) -> Floats:
    """(n,) normalised squares eᵀ P⁻¹ e of deviations (n, D) with covariances (n, D, D); NaN where one is unknown.

    NaN, too, where P is not positive definite: where a correlation has an eigenvalue below `LEAST_EIGENVALUE`. Of
    estimation errors this is the NEES, of innovations the NIS (Bar-Shalom, Li, Kirubarajan 2001, section 5.4).
    """
    result = np.full(len(deviations), np.nan)
    variances = np.diagonal(covs, axis1=1, axis2=2)
    finite = np.isfinite(deviations).all(axis=1) & np.isfinite(covs).all(axis=(1, 2))
    rows = np.flatnonzero(finite & (variances > 0.0).all(axis=1))
    scale = np.sqrt(variances[rows])
    white, correlations = deviations[rows] / scale, covs[rows] / (scale[:, :, None] * scale[:, None, :])
    definite = np.linalg.eigvalsh(correlations)[:, 0] > LEAST_EIGENVALUE
    white = white[definite]
    result[rows[definite]] = (white * np.linalg.solve(correlations[definite], white[..., None])[..., 0]).sum(axis=1)
    return result


def mean_error(errors: Floats) -> float:
    """Mean error over the steps with an estimate; NaN without one."""
    known = errors[np.isfinite(errors)]
    return float(known.mean()) if known.size else float("nan")
