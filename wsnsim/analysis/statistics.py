"""Statistics over Monte Carlo runs: medians, means, shares, paired differences and tests, Pareto front.

Confidence intervals are of 95 %. The bootstrap's seed is the number of values, so that equal values give equal
intervals. Unknown values (NaN) are left out; with fewer than five known values there is no interval. SciPy is imported
for p-values only: its statistics take half a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints

DRAWS: Final = 2000
LEAST: Final = 5
EXACT: Final = 50
"""Pairs up to which Wilcoxon's p is exact, ties included; for more, the normal approximation is close enough."""
CONFIDENCE: Final = 0.95
TAIL: Final = (1.0 - CONFIDENCE) / 2.0
NORMAL: Final = NormalDist().inv_cdf(1.0 - TAIL)
"""Standard deviations from the mean to the ends of the interval of a Gaussian."""
MOST_SAMPLED: Final = 2_000_000
"""Values that the bootstrap samples at once: bounds the memory."""


class IntervalEstimate(NamedTuple):
    """A statistic, its confidence interval, and the number of known values."""

    value: float
    low: float
    high: float
    known: int


class PairedDifference(NamedTuple):
    """The median of paired differences.

    Attributes:
        value: the median.
        low: lower end of its confidence interval.
        high: upper end.
        effect: matched-pairs rank-biserial correlation (Kerby 2014): 1 if all differences are positive, −1 if all are
            negative, 0 without a tendency.
        p: of Wilcoxon's signed-rank test, two-sided.
        known: number of pairs in which both values are known.
    """

    value: float
    low: float
    high: float
    effect: float
    p: float
    known: int


def median(values: Floats) -> IntervalEstimate:
    """The median of the known values with its bootstrap interval."""
    return _estimated(values, np.median)


def mean(values: Floats) -> IntervalEstimate:
    """The mean of the known values with its bootstrap interval."""
    return _estimated(values, np.mean)


def _estimated(values: Floats, statistic: Any) -> IntervalEstimate:
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    return IntervalEstimate(
        float(statistic(known)) if known.size else math.nan, *_bootstrapped(known, statistic), known.size
    )


def share(flags: Bools) -> IntervalEstimate:
    """The share of runs in which something happened, with its score interval (Wilson 1927)."""
    count = len(flags)
    if not count:
        return IntervalEstimate(math.nan, math.nan, math.nan, 0)
    happened = int(np.count_nonzero(flags))
    part, square = happened / count, NORMAL * NORMAL
    middle = (2.0 * happened + square) / (2.0 * (count + square))
    half = NORMAL / (2.0 * (count + square)) * math.sqrt(4.0 * happened * (1.0 - part) + square)
    return IntervalEstimate(part, middle - half if happened else 0.0, middle + half if happened < count else 1.0, count)


def paired_difference(values: Floats, baseline: Floats) -> PairedDifference:
    """The paired difference `values` − `baseline`, both (n,) of the same runs, NaN if unknown."""
    pairs = np.column_stack([np.asarray(values, dtype=np.float64), np.asarray(baseline, dtype=np.float64)])
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    differences = pairs[:, 0] - pairs[:, 1]
    if not differences.size:
        return PairedDifference(math.nan, math.nan, math.nan, math.nan, math.nan, 0)
    low, high = _bootstrapped(differences, np.median)
    effect, p = _ranked(differences)
    return PairedDifference(float(np.median(differences)), low, high, effect, p, differences.size)


def exact_mcnemar(one: int, other: int) -> float:
    """The two-sided p-value of McNemar's exact test on pairs of yes and no.

    Source: McNemar (1947), doi:10.1007/BF02295996; exact: the binomial test of the discordant pairs.

    Args:
        one: pairs in which only the first is yes.
        other: pairs in which only the second is yes.
    """
    from scipy import stats  # slow to import

    return float(stats.binomtest(one, one + other, 0.5).pvalue) if one + other else 1.0


def holm(p: Sequence[float]) -> list[float]:
    """P-values adjusted for the number of tests, by Holm (1979), in the same order; NaN, not tested, does not count."""
    tested = sorted((value, i) for i, value in enumerate(p) if value == value)
    adjusted, highest = [math.nan] * len(p), 0.0
    for rank, (value, i) in enumerate(tested):
        highest = max(highest, min(1.0, (len(tested) - rank) * value))
        adjusted[i] = highest
    return adjusted


def pareto_front(errors: Sequence[float], costs: Sequence[float]) -> Bools:
    """Which points are on the Pareto front, (n,): no other has less of one and at most as much of the other.

    A point with an unknown error or cost is not on it.
    """
    pairs = np.column_stack([np.asarray(errors, dtype=np.float64), np.asarray(costs, dtype=np.float64)])
    known = np.isfinite(pairs).all(axis=1)
    beaten = np.array(
        [bool(((pairs[known] <= row).all(axis=1) & (pairs[known] < row).any(axis=1)).any()) for row in pairs],
        dtype=np.bool_,
    )
    return known & ~beaten


def _ranked(differences: Floats) -> tuple[float, float]:
    """(rank-biserial correlation, p) of differences; zero differences are left out."""
    from scipy import stats  # slow to import

    moved = differences[differences != 0.0]
    if not moved.size:
        return 0.0, 1.0
    ranks = stats.rankdata(np.abs(moved))
    effect = float((ranks[moved > 0.0].sum() - ranks[moved < 0.0].sum()) / ranks.sum())
    if moved.size > EXACT:
        return effect, float(stats.wilcoxon(moved).pvalue)
    return effect, _exact_p(np.rint(2.0 * ranks).astype(np.int64), moved > 0.0)


def _exact_p(ranks: Ints, positive: Bools) -> float:
    """The p-value over all equally likely signs; ranks are doubled, so that tied ones are integers."""
    ways = np.zeros(ranks.sum() + 1)
    ways[0] = 1.0
    for rank in ranks:  # number of sign choices that give each sum of positive ranks
        ways[rank:] += ways[:-rank].copy()
    seen, many = ranks[positive].sum(), 2.0**ranks.size
    return float(min(1.0, 2.0 * min(ways[: seen + 1].sum(), ways[seen:].sum()) / many))


def _bootstrapped(known: Floats, statistic: Any) -> tuple[float, float]:
    """The interval by percentile bootstrap."""
    if known.size < LEAST:
        return math.nan, math.nan
    if (known == known[0]).all():
        return float(known[0]), float(known[0])
    rng = np.random.Generator(np.random.Philox(known.size))
    at_once, found = max(1, MOST_SAMPLED // known.size), []
    for first in range(0, DRAWS, at_once):
        chosen = rng.integers(0, known.size, (min(at_once, DRAWS - first), known.size))
        found.append(statistic(known[chosen], axis=-1))
    low, high = np.quantile(np.concatenate(found), (TAIL, 1.0 - TAIL))
    return float(low), float(high)
