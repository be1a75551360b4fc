"""The rule that gives each claim of a paper its verdict. docs/verdicts.md explains it and shows its power.

    judged_value(sample, PublishedValue(...)) -> Judgement      from the 95 % interval of the ratio measured / published
    judged_order(difference) -> Judgement                       from that of the difference of two variants
    RULE                                                  the rule in words, by verdict

Both errors count: the published value is itself a mean over a few runs, whose Monte Carlo error is taken from our runs,
resampled as many at a time as the paper made. Noise widens the interval, and a wide interval reproduces nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.papers.resampling import Sample, median_of_runs, value, weights

Verdict = Literal[
    "reproduces", "compatible", "within a factor of two", "does not reproduce", "cannot: beyond the bound", "undecided",
    "too few runs", "not judged", "not published",
]  # fmt: skip
CLOSE: Final = 1.1
"""Ratio up to which a measured value reproduces the published one, in both directions."""
FACTOR: Final = 2.0
LEAST: Final = 30
"""Runs from which on anything random is judged."""
ENOUGH: Final = 200
"""Runs from which on a mean or an RMSE is judged: with fewer, 2 % of runs that go astray may all be missed."""
ASTRAY: Final = 5.0
"""Multiple of the median over runs above which a run is astray [our choice]."""
MOST: Final = 0.5
"""A fraction from here on is judged like a median: it is at most 1, so that few runs cannot move it far."""
TAIL: Final = 0.025
NAN: Final = float("nan")
INF: Final = float("inf")

RULE: Final[Mapping[Verdict, str]] = {
    "reproduces": "the 95 % interval of the ratio measured / published lies within 1/1.1 ... 1.1 (the ratio of two "
    "rivals: also on the published side of 1); of an order: that of the difference has the published sign throughout",
    "compatible": "that interval lies neither within 1/1.1 ... 1.1 nor outside; x r: its farthest end. No success",
    "within a factor of two": "the interval lies outside 1/1.1 ... 1.1, but within 1/2 ... 2. No success",
    "does not reproduce": "the interval lies outside 1/1.1 ... 1.1, and reaches beyond 1/2 or 2; of an order: the "
    "whole interval of the difference has the other sign, or there is no difference",
    "cannot: beyond the bound": "the published value is below a strict bound, "
    "which no filter is on average over ground truths",
    "undecided": "of an order: the interval contains zero",
    "too few runs": "however far it is from the published value, a median is not judged on fewer than "
    f"{LEAST} runs, a mean or an RMSE not on fewer than {ENOUGH}, as rare runs with large errors may be missing; "
    f"{LEAST} runs can show that a mean is too large",
    "not judged": "the two cannot be compared, such as seconds on two machines",
}
"""How a verdict is reached."""
OUT_OF_REACH: Final = "out of reach"
"""Said of claims that are undecidable."""


class Judgement(NamedTuple):
    """A verdict and what it rests on.

    Attributes:
        verdict: the verdict.
        low: lower end of the 95 % interval of measured / published; NaN without one, and for orders.
        high: its upper end; infinite for a mean over too few runs.
        lasting: the upper end over the lower one of the interval that the published runs alone make, which stays
            however many runs we make; 1 if the published value has no Monte Carlo error.
    """

    verdict: Verdict
    low: float = NAN
    high: float = NAN
    lasting: float = 1.0

    @property
    def undecidable(self) -> bool:
        """Whether the lasting interval is wider than the band 1/1.1 ... 1.1, so that nothing can reproduce."""
        return self.lasting > CLOSE**2

    @property
    def within(self) -> float:
        """The factor within which both values agree: the farthest end of the interval; NaN without one."""
        return max(self.high, 1.0 / self.low) if self.low > 0.0 else INF if self.low == 0.0 else NAN


class PublishedValue(NamedTuple):
    """A published value and what is known of it.

    Attributes:
        value: the value.
        runs: the Monte Carlo runs behind it; 0 if it has no Monte Carlo error.
        exact: whether the measured value is not random.
        fraction: whether it is a fraction, of at most 1.
        rivals: whether it is a ratio of two variants, which has to be on the published side of 1.
    """

    value: float
    runs: int = 0
    exact: bool = False
    fraction: bool = False
    rivals: bool = False

    @property
    def bounded(self) -> bool:
        """Whether a few runs cannot move it far: a fraction of one half or more."""
        return self.fraction and self.value >= MOST


class AstrayShare(NamedTuple):
    """The share of runs that are astray, with its 95 % interval (Clopper and Pearson 1934)."""

    value: float = NAN
    low: float = NAN
    high: float = NAN


NO_SHARE: Final = AstrayShare()


def astray(per_run: Floats) -> AstrayShare:
    """The share of runs whose value is more than ASTRAY times the median over the runs; NaN if that is not positive."""
    known = per_run[np.isfinite(per_run)]
    if not known.size or not np.median(known) > 0.0:
        return NO_SHARE
    count = int(np.count_nonzero(known > ASTRAY * np.median(known)))
    from scipy import stats  # takes half a second to import, and every run looks up what its paper publishes

    interval = stats.binomtest(count, known.size).proportion_ci(1.0 - 2.0 * TAIL, method="exact")
    return AstrayShare(count / known.size, float(interval.low), float(interval.high))


def ratio_interval(sample: Sample, published: Floats | float, published_runs: int) -> tuple[Floats, Floats]:
    """The 95 % interval of measured / published, both positive: a bootstrap of the difference of their logarithms.

    Our runs are resampled twice: as many as they are, for our error, and `published_runs` at a time, for the published
    one (m out of n bootstrap); with 0, the published value has no error.

    Args:
        sample: our runs; with more axes than runs and tracks, the last is one of independent samples.
        published: the published value, or one for each sample.
        published_runs: the number of runs behind it.
    """
    count = len(sample.runs)
    now = sample.at(np.ones((1, count)))[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.log(sample.at(weights(count, count)) / now)
        if published_runs:
            moved = moved + np.log(sample.at(weights(count, published_runs, published=True)) / now)
        low, high = np.quantile(np.nan_to_num(moved, nan=0.0, posinf=INF, neginf=-INF), [TAIL, 1.0 - TAIL], axis=0,
                                method="inverted_cdf")  # fmt: skip
        return np.exp(low) * now / published, np.exp(high) * now / published


def lasting_interval(sample: Sample, published_runs: int) -> float:
    """The upper end over the lower one of the 95 % interval of the statistic of so many runs, drawn from ours."""
    if not published_runs:
        return 1.0
    drawn = sample.at(weights(len(sample.runs), published_runs, published=True))
    low, high = np.nanquantile(drawn, [TAIL, 1.0 - TAIL])
    return float(high / low) if low > 0.0 else INF


def verdict_on_ratio(low: float, high: float) -> Verdict:
    """The verdict on the interval of a ratio, by RULE."""
    if low >= 1.0 / CLOSE and high <= CLOSE:
        return "reproduces"
    if low <= CLOSE and high >= 1.0 / CLOSE:
        return "compatible"
    return "within a factor of two" if low >= 1.0 / FACTOR and high <= FACTOR else "does not reproduce"


def judged_value(sample: Sample, published: PublishedValue) -> Judgement:
    """The judgement on a published value.

    Args:
        sample: our runs, each with a known value; without any, there are too few.
        published: the published value.
    """
    count, now = len(sample.runs), value(sample)
    if np.isnan(now):
        return Judgement("too few runs")
    if published.exact or is_exact(sample.per_run) or not (now > 0.0 and published.value > 0.0):
        return _judged_exactly(now, published.value)
    if count < LEAST:
        return Judgement("too few runs")
    low, high = (float(end) for end in ratio_interval(sample, published.value, published.runs))
    lasting = lasting_interval(sample, published.runs)
    if count < ENOUGH and not sample.statistic.robust and not published.bounded:
        return _judged_one_sidedly(sample, published, low)._replace(lasting=lasting)
    verdict = verdict_on_ratio(low, high)
    if verdict == "reproduces" and published.rivals and not _on_same_side(sample, published.value):
        verdict = "compatible"
    return Judgement(verdict, low, high, lasting)


def _judged_exactly(measured: float, published: float) -> Judgement:
    """The judgement on a value without Monte Carlo error, and where there is no ratio, as with zero."""
    if measured == published:
        return Judgement("reproduces", 1.0, 1.0)
    if not measured * published > 0.0:
        return Judgement("does not reproduce")
    ratio = measured / published
    return Judgement(verdict_on_ratio(ratio, ratio), ratio, ratio)


def _judged_one_sidedly(sample: Sample, published: PublishedValue, low: float) -> Judgement:
    """The judgement on a mean of too few runs: unseen runs may raise it without limit, but hardly lower it.

    The median over the runs has to be too large as well, since a few runs do not move it.
    """
    if published.rivals:
        return Judgement("too few runs")
    low = min(low, float(ratio_interval(median_of_runs(sample), published.value, published.runs)[0]))
    return Judgement("does not reproduce" if low > CLOSE else "too few runs", low, INF)


def _on_same_side(sample: Sample, published: float) -> bool:
    """Whether the whole interval of a ratio is on the side of 1 on which the published one is, if it is on one."""
    count = len(sample.runs)
    low, high = np.quantile(sample.at(weights(count, count)), [TAIL, 1.0 - TAIL])
    return bool(published == 1.0 or (high < 1.0 if published < 1.0 else low > 1.0))


def is_exact(per_run: Floats) -> bool:
    """Whether a value is the same in every run, of five or more; 0 and 1 do not count, as shares are cut off there."""
    same = np.isclose(per_run, per_run[0], rtol=1e-9, atol=0.0).all()
    return bool(len(per_run) >= 5 and same and per_run[0] not in (0.0, 1.0))


def verdict_on_order(low: float, high: float) -> Verdict:
    """The verdict on the interval of a difference that is negative as published, by RULE."""
    if high < 0.0:
        return "reproduces"
    return "does not reproduce" if low > 0.0 or low == high == 0.0 else "undecided"


def interval(sample: Sample) -> tuple[float, float]:
    """The 95 % bootstrap interval of a statistic; NaN with fewer than five runs, and if none has a value."""
    count = len(sample.runs)
    if count < 5 or np.isnan(value(sample)):
        return NAN, NAN
    low, high = np.nanquantile(sample.at(weights(count, count)), [TAIL, 1.0 - TAIL])
    return float(low), float(high)


def judged_order(difference: Sample, exact: bool = False) -> Judgement:
    """The judgement on the difference of two variants, paired by run.

    Args:
        difference: the published statistic of the one less that of the other.
        exact: whether the values are not random.
    """
    count, per_run, now = len(difference.runs), difference.per_run, value(difference)
    if np.isnan(now):
        return Judgement("too few runs")
    if exact or is_exact(per_run) or not per_run.any():
        return Judgement(verdict_on_order(now, now))
    if count < (LEAST if difference.statistic.robust else ENOUGH):
        return Judgement("too few runs")
    return Judgement(verdict_on_order(*interval(difference)))
