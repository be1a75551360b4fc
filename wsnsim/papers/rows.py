"""The rows of a reproduction: each claim with its measured value, bound and verdict.

rows_of(claim, data) -> [ClaimRow, ...]       the row of a claim, and beside an order that of its paired differences
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from wsnsim.analysis import statistics
from wsnsim.papers import measures
from wsnsim.papers.bounds_beside import bound_beside
from wsnsim.papers.measures import Data
from wsnsim.papers.reproduction import NAN, BoundBeside, Claim, ClaimRow
from wsnsim.papers.resampling import Resampled, known, median_of_runs, value
from wsnsim.papers.verdicts import Judgement, astray, interval, judged_order, judged_value

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
        judgement=_judgement(claim, data, bound.strict), statistic=sample.words, short=sample.key,
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


def _order_row(claim: Claim, data: Data, difference: Resampled) -> ClaimRow:
    """The row of an order, from the difference of its variants."""
    low, high = interval(difference)
    row = ClaimRow(
        quantity=claim.label, variant=claim.variant, published=NAN, measured=value(difference), low=low, high=high,
        replicates=len(difference.runs), lost_fraction=_lost(claim, data), bound=NAN, bound_kind="",
        judgement=judged_order(difference, claim.deterministic), reason=claim.reason,
        statistic=difference.words, short=difference.key,
    )  # fmt: skip
    return _completed(row, claim, data)


def _completed(row: ClaimRow, claim: Claim, data: Data) -> ClaimRow:
    """The row with what it takes over from the claim, and with the variant's losses."""
    return replace(
        row, literal=claim.literal, basis=claim.basis, read=claim.read and claim.published is not None, id=claim.id,
        key=claim.key, published_runs=0 if claim.published is None else claim.published_runs,
        losses=measures.losses(data, claim.variant),
    )  # fmt: skip


def _lost(claim: Claim, data: Data) -> float:
    """The fraction of runs in which one of an order's variants lost the target."""
    return float((data.lost(claim.variant) | data.lost(claim.other)).mean())
