"""The rows of a reproduction: each claim with its measured value, a bound in the terms of its measure, and a verdict.

rows_of(claim, data) -> [ClaimRow, ...]       the row of a claim, and beside an order that of its paired differences
bound_beside(data, variant, measure, kind) -> BoundBeside
bound_from_events(data, variant, readings) -> Series by replicate
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis import statistics
from wsnsim.analysis.frames import read
from wsnsim.base.arrays import Floats
from wsnsim.papers import measures
from wsnsim.papers.measures import Data, measured
from wsnsim.papers.reproduction import NAN, BoundBeside, Claim, ClaimRow
from wsnsim.papers.resampling import Resampled, known, median_of_runs, value
from wsnsim.papers.verdicts import Judgement, astray, interval, judged_order, judged_value

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
            estimates = read(batch.path, "estimates", ["replicate", "target", "step", "error"])
            each = bound.of_replicates_at(_errors(estimates, bound))
            found |= dict(zip(bound.query.replicates, each.tolist(), strict=True))
    return pd.Series(found)


def _errors(estimates: pd.DataFrame, bound: bounds.Bound) -> Floats:
    """(replicates, targets, steps) errors of a bound's runs, NaN where there is no estimate."""
    errors = np.full(bound.each.shape, np.nan)
    rows = pd.Index(list(bound.query.replicates)).get_indexer(estimates["replicate"])
    errors[rows, estimates["target"].to_numpy(), estimates["step"].to_numpy() - 1] = estimates["error"].to_numpy()
    return errors


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
