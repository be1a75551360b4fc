"""What a reproduction says: the rows of claims, and the answers to hypotheses that were registered before the runs.

A row is a claim with its measured value, a bound in the terms of its measure, and a verdict.

rows_of(claim, data) -> [ClaimRow, ...]       the row of a claim, and beside an order that of its paired differences
bound_beside(data, variant, measure, kind) -> BoundBeside
bound_from_events(data, variant, readings) -> Series by replicate
resamples(statistic) -> (1 + draws,)    a statistic of the runs as they are, and of every resample
interval(values) -> Interval            of a value and its resamples
ends(low, high) -> ' [0.90, 1.10]'      the ends of an interval in words
Interval.above(threshold)               True, False, or None if the interval contains the threshold
Answer(words, found, answer)            'yes', 'no' or 'undecided', with the intervals that it follows from
answered(hypothesis, data) -> Answer    of a hypothesis that a study's file declares
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis import statistics
from wsnsim.analysis.error_bounds import errors_at
from wsnsim.base.arrays import Floats
from wsnsim.papers import measures, verdicts
from wsnsim.papers.measures import Data, measured
from wsnsim.papers.reproduction import NAN, BoundBeside, Claim, ClaimRow
from wsnsim.papers.resampling import DRAWS, Sample, known, median_of_runs, value, weights
from wsnsim.papers.study_file import RegisteredHypothesis
from wsnsim.papers.verdicts import TAIL, Judgement, astray, judged_order, judged_value

FROM_EVENTS: Final = ("active", "arrived")
OF_EACH_RUN: Final = "per_run_rmse"
OF_SQUARES: Final = "it limits the mean square over runs, and the mean of the runs' RMSE can be below its root"


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
        if measure.startswith(OF_EACH_RUN):
            return BoundBeside(best.low, f"that of '{rest}', not strict", caution=f"{caution}; {OF_SQUARES}")
        return BoundBeside(best.low, f"that of '{rest}'", best.low, caution)
    if family == "own":
        return BoundBeside(measured(data, variant, f"median:{rest}").value, f"{rest.replace('_', ' ')}, not strict")
    if kind in FROM_EVENTS:
        runs = bound_from_events(data, variant, kind)
        caution = "; ".join(data.bound(variant, "per_trajectory").cautions)
        value = float(runs.median()) if measure == "median:rmse" else float("nan")
        return BoundBeside(value, f"{kind}, not strict", caution=caution) if np.isfinite(value) else BoundBeside()
    found = data.bound(variant, kind)
    value = float("nan") if found.reason else _in_terms(found, measure, data.states(variant))
    if not np.isfinite(value):
        return BoundBeside()
    cautions = (*found.cautions, *([OF_SQUARES] if measure.startswith(OF_EACH_RUN) else ()))
    if kind == "unconditional" and not cautions:
        return BoundBeside(value, kind, value)
    return BoundBeside(value, f"{kind}, not strict", caution="; ".join(cautions))


def bound_from_events(data: Data, variant: str, readings: str) -> pd.Series:
    """The bound (m) of each run for measurements that were active or arrived; needs events, estimates, clusters.

    Only steps with an estimate count, as in the RMSE of the run beside it.
    """
    point = data.manifest.points[data.variants.index(variant)]
    found: dict[int, float] = {}
    for batch in data.folder.batches(point.id):
        bound = bounds.bound_of_run(batch.path, readings, "per_trajectory")
        if not bound.reason:
            each = bound.of_replicates_at(errors_at(batch.path, bound))
            found |= dict(zip(bound.query.replicates, each.tolist(), strict=True))
    return pd.Series(found)


def _in_terms(found: bounds.Bound, measure: str, states: Sequence[tuple[str, str]]) -> float:
    name, _, column = measure.partition(":")
    if name == "rmse":
        return found.time_mean
    if name in ("column", OF_EACH_RUN):
        index = [state for state, _ in states].index(column)
        variances = found.covariances[..., index, index]
        return float(np.sqrt(variances.mean() if name == "column" else variances.mean(axis=(1, 2))).mean())
    return float(np.median(found.of_replicates)) if measure == "median:rmse" else float("nan")


USUAL_REASONS: Final = {
    "median:rmse": "unlike the mean, the median is not moved by single runs that diverge",
    "mean:energy": "the cost of the accuracy above",
}
"""{measure: reason} for claims that give none."""
OTHER_REASON: Final = "for comparison; the paper prints no such value"
"""The reason of a claim that gives none, for all other measures."""


def rows_of(claim: Claim, data: Data) -> list[ClaimRow]:
    """The rows of a claim, their reasons still format strings, without paper and experiment."""
    if not claim.other:
        return [_value_row(claim, data)]
    difference = measures.difference(data, claim.variant, claim.other, claim.measure)
    published = _order_row(claim, data, difference)
    return [published, replace(_order_row(claim, data, median_of_runs(difference)), paired=True)]


def _value_row(claim: Claim, data: Data) -> ClaimRow:
    """The row of a value."""
    sample = known(measures.sample(data, claim.variant, claim.measure))
    bound = bound_beside(data, claim.variant, claim.measure, claim.bound) if claim.bound else BoundBeside()
    found = measures.measured(data, claim.variant, claim.measure)
    middle = statistics.median(sample.per_run)
    row = ClaimRow(
        quantity=claim.label, variant=claim.variant, published=NAN if claim.published is None else claim.published,
        measured=found.value, low=found.low, high=found.high, replicates=found.replicates,
        lost_fraction=found.lost_fraction, bound=bound.value, bound_kind=bound.kind, caution=bound.caution,
        judgement=_judgement(claim, data, bound.strict), statistic=sample.statistic.words,
        astray=astray(sample.per_run), median=(middle.value, middle.low, middle.high),
        reason=claim.reason or USUAL_REASONS.get(claim.measure, OTHER_REASON),
    )  # fmt: skip
    return _completed(row, claim, data)


def _judgement(claim: Claim, data: Data, strict: float) -> Judgement:
    """The judgement on a claimed value."""
    if claim.published is None:
        return Judgement("not published")
    if not claim.judged:
        return Judgement("not judged")
    if claim.published < strict:
        return Judgement("cannot: beyond the bound")
    return judged_value(*measures.judged_terms(data, claim))


def _order_row(claim: Claim, data: Data, difference: Sample) -> ClaimRow:
    """The row of an order, from the difference of its variants."""
    low, high = verdicts.interval(difference)
    row = ClaimRow(
        quantity=claim.label, variant=claim.variant, published=NAN, measured=value(difference), low=low, high=high,
        replicates=len(difference.runs), bound=NAN, bound_kind="",
        lost_fraction=float((data.lost(claim.variant) | data.lost(claim.other)).mean()),
        judgement=judged_order(difference, claim.deterministic), reason=claim.reason,
        statistic=difference.statistic.words,
    )  # fmt: skip
    return _completed(row, claim, data)


def _completed(row: ClaimRow, claim: Claim, data: Data) -> ClaimRow:
    """The row with what it takes over from the claim, and with the variant's losses."""
    return replace(
        row, literal=claim.literal, basis=claim.basis, read=claim.read and claim.published is not None, id=claim.id,
        key=claim.key, where=claim.where, published_runs=0 if claim.published is None else claim.published_runs,
        published_runs_assumed=claim.published_runs_assumed and claim.published is not None,
        losses=measures.losses(data, claim.variant),
    )  # fmt: skip


Word: TypeAlias = Literal["yes", "no", "undecided"]
_WORDS: Final[Mapping[bool | None, Word]] = {True: "yes", False: "no", None: "undecided"}


class Interval(NamedTuple):
    """A value with its 95 % interval; NaN without one."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return "unknown" if np.isnan(self.value) else f"{self.value:.2f}{ends(self.low, self.high)}"

    def above(self, threshold: float) -> bool | None:
        """Whether the whole interval is above a threshold, or below it; None if it is neither, or unknown."""
        if self.low > threshold:
            return True
        return False if self.high < threshold else None

    def below(self, threshold: float) -> bool | None:
        """Whether the whole interval is below a threshold, or above it; None if it is neither, or unknown."""
        above = self.above(threshold)
        return None if above is None else not above


UNKNOWN: Final = Interval(float("nan"), float("nan"), float("nan"))


class Answer(NamedTuple):
    """The answer to a registered hypothesis."""

    words: str
    found: tuple[Interval, ...]
    answer: Word

    def __str__(self) -> str:
        return f"{self.words}: {self.answer}" + (f", {' and '.join(map(str, self.found))}" if self.found else "")


def answered(hypothesis: RegisteredHypothesis, data: Data) -> Answer:
    """The answer to a hypothesis, over the runs that have a value; undecided if its interval has the threshold."""
    found = interval(resamples(known(measures.sample(data, hypothesis.of, hypothesis.measure))))
    if hypothesis.above is not None:
        holds = found.above(hypothesis.above)
    else:
        assert hypothesis.below is not None, "one of both, as the study's file is checked"
        holds = found.below(hypothesis.below)
    return Answer(hypothesis.says, (found,), word(holds))


def resamples(found: Sample) -> Floats:
    """(1 + draws,) a statistic of the runs as they are, and of every resample."""
    count = len(found.runs)
    return np.concatenate([found.at(np.ones((1, count))), found.at(weights(count, count))])


def interval(values: Floats) -> Interval:
    """The interval of a value (1 + draws,), the first of which is that of all runs; NaN if a resample has no value."""
    assert len(values) == 1 + DRAWS
    with np.errstate(invalid="ignore"):  # between infinite values
        low, high = np.quantile(values[1:], [TAIL, 1.0 - TAIL])
    return Interval(float(values[0]), float(low), float(high))


def ends(low: float, high: float, form: str = ".2f") -> str:
    """The ends of an interval as they follow a value in a text; '' if they are not known."""
    return f" [{low:{form}}, {high:{form}}]" if math.isfinite(low) and not math.isnan(high) else ""


def word(holds: bool | None) -> Word:
    """'yes' if a hypothesis holds, 'no' if it does not, 'undecided' if it is not known."""
    return _WORDS[holds]


def both(one: bool | None, other: bool | None) -> bool | None:
    """Whether two statements hold; None if that is not known."""
    if one is False or other is False:
        return False
    return None if one is None or other is None else True
