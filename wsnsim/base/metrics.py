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
CONSISTENT_MEDIANS = {1: 0.4549, 2: 0.6931, 3: 0.7887}
"""Median of a chi-square variable over its degrees of freedom: of the NEES of a consistent filter, per column."""
LOST_WINDOW = 4.0
"""Time (s) without a good estimate after which a track is lost, at least `LOST_STEPS` steps: our choice."""
LOST_STEPS = 3
LOST_SHARE = 1.0 / 3.0
"""Share of the sensing range above which the error of a lost track is: 20 m in Jiang's field (2013). Our choice."""
LOST_ERROR = 20.0
"""The same in m where the sensing range is infinite."""


def rmse(errors: Floats) -> float:
    """Root mean square error over the steps with an estimate; NaN without one."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def median_error(errors: Floats) -> float:
    """Median error over the steps with an estimate; NaN without one."""
    known = errors[np.isfinite(errors)]
    return float(np.median(known)) if known.size else float("nan")


def lost_steps(errors: Floats, window: int, limit: float) -> Bools:
    """(steps,) whether the track is lost at each step, of the errors (steps,) of one track.

    It is at the steps of each uninterrupted stretch of at least `window` steps whose error is above `limit` metres or
    that have no estimate. The rule is our choice: Jiang (2013) gives none.
    """
    ends = np.flatnonzero(np.diff(~(errors <= limit), prepend=False, append=False)).reshape(-1, 2)
    first, last = ends[ends[:, 1] - ends[:, 0] >= window].T
    change = np.zeros(errors.size + 1, dtype=np.int64)
    change[first], change[last] = 1, -1
    return np.cumsum(change[:-1]) > 0


def count_losses(lost: Bools) -> int:
    """The number of losses of one track, of `lost_steps`: uninterrupted stretches of lost steps."""
    return int(np.count_nonzero(lost[1:] & ~lost[:-1])) + int(lost[:1].any())


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
    return mean_error(per_step_rmse(np.atleast_2d(errors)))


def averaged_rmse(errors: Floats) -> float:
    """The time-averaged RMSE of (runs, targets, steps) errors; of one run, its RMSE over steps and targets."""
    return rmse(errors) if len(errors) == 1 else time_mean_rmse(errors.reshape(-1, errors.shape[-1]))


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
