"""What replicates say: medians and means with intervals, shares, paired differences, and who is not beaten.

Intervals are of 95 %. The bootstrap's draws are fixed by the number of values, so that equal values give equal
intervals. Values that are not known (NaN) are passed over; fewer than five known values have no interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from wsnsim.base.arrays import Bools, Floats, Ints

DRAWS: Final = 2000
LEAST: Final = 5
EXACT: Final = 50
"""Pairs up to which Wilcoxon's p is exact, those of equal size included; for more, the normal law is close enough."""
CONFIDENCE: Final = 0.95
NAN: Final = float("nan")


class IntervalEstimate(NamedTuple):
    """A figure, its interval, and how many known values are behind it."""

    value: float
    low: float
    high: float
    known: int


class PairedDifference(NamedTuple):
    """The median of the differences of pairs, its interval, an effect size, a p-value, and how many pairs are known.

    `effect` is the matched-pairs rank-biserial correlation (Kerby 2014): 1 if every difference is positive, −1 if every
    one is negative, 0 if there is no tendency. `p` is Wilcoxon's signed-rank test's, of two sides.
    """

    value: float
    low: float
    high: float
    effect: float
    p: float
    known: int


def median(values: Floats) -> IntervalEstimate:
    """The median of the known values, with its bootstrap interval."""
    known = _known(values)
    low, high = _bootstrapped(known, np.median)
    return IntervalEstimate(float(np.median(known)) if known.size else NAN, low, high, known.size)


def mean(values: Floats) -> IntervalEstimate:
    """The mean of the known values, with its bootstrap interval."""
    known = _known(values)
    low, high = _bootstrapped(known, np.mean)
    return IntervalEstimate(float(np.mean(known)) if known.size else NAN, low, high, known.size)


def interval_of_median(values: Floats) -> tuple[float, float]:
    """The bootstrap's interval of the median; NaN where fewer than five values are known."""
    found = median(values)
    return found.low, found.high


def share(flags: Bools) -> IntervalEstimate:
    """The share of runs in which something happened, with Wilson's score interval (Wilson 1927)."""
    count = len(flags)
    if not count:
        return IntervalEstimate(NAN, NAN, NAN, 0)
    happened = int(np.count_nonzero(flags))
    interval = stats.binomtest(happened, count).proportion_ci(CONFIDENCE, method="wilson")
    return IntervalEstimate(happened / count, float(interval.low), float(interval.high), count)


def paired_difference(values: Floats, baseline: Floats) -> PairedDifference:
    """What `values` have more than `baseline`, pair by pair: both (n,) of the same replicates, NaN where unknown."""
    pairs = np.column_stack([np.asarray(values, dtype=np.float64), np.asarray(baseline, dtype=np.float64)])
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    differences = pairs[:, 0] - pairs[:, 1]
    if not differences.size:
        return PairedDifference(NAN, NAN, NAN, NAN, NAN, 0)
    low, high = _bootstrapped(differences, np.median)
    effect, p = _ranked(differences)
    return PairedDifference(float(np.median(differences)), low, high, effect, p, differences.size)


def pareto_front(errors: Sequence[float], costs: Sequence[float]) -> Bools:
    """(n,) which are not beaten: no other has less of both, or less of one and as much of the other (Pareto).

    One whose error or cost is unknown is never in front.
    """
    pairs = np.column_stack([np.asarray(errors, dtype=np.float64), np.asarray(costs, dtype=np.float64)])
    known = np.isfinite(pairs).all(axis=1)
    beaten = np.array(
        [bool(((pairs[known] <= row).all(axis=1) & (pairs[known] < row).any(axis=1)).any()) for row in pairs],
        dtype=np.bool_,
    )
    return known & ~beaten


def _ranked(differences: Floats) -> tuple[float, float]:
    """(rank-biserial correlation, p) of differences; those of zero count for neither side."""
    moved = differences[differences != 0.0]
    if not moved.size:
        return 0.0, 1.0
    ranks = stats.rankdata(np.abs(moved))
    effect = float((ranks[moved > 0.0].sum() - ranks[moved < 0.0].sum()) / ranks.sum())
    if moved.size > EXACT:
        return effect, float(stats.wilcoxon(moved).pvalue)
    return effect, _exact_p(np.rint(2.0 * ranks).astype(np.int64), moved > 0.0)


def _exact_p(ranks: Ints, positive: Bools) -> float:
    """The p-value over all choices of signs, each as likely; ranks are doubled, so that shared ones are whole."""
    ways = np.zeros(ranks.sum() + 1)
    ways[0] = 1.0
    for rank in ranks:  # in how many ways positive ranks make up each sum
        ways[rank:] += ways[:-rank].copy()
    seen, many = ranks[positive].sum(), 2.0**ranks.size
    return float(min(1.0, 2.0 * min(ways[: seen + 1].sum(), ways[seen:].sum()) / many))


def _bootstrapped(known: Floats, statistic: Any) -> tuple[float, float]:
    """The percentile bootstrap's interval."""
    if known.size < LEAST:
        return NAN, NAN
    if (known == known[0]).all():
        return float(known[0]), float(known[0])
    found = stats.bootstrap(
        (known,),
        statistic,
        n_resamples=DRAWS,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        batch=max(1, 2_000_000 // known.size),
        rng=np.random.Generator(np.random.Philox(known.size)),
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def _known(values: Floats) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    return array[np.isfinite(array)]
