"""Bounds beside the measured values of a reproduction, in the terms of a measure.

bound_beside(data, variant, measure, kind) -> BoundBeside
bound_from_events(data, variant, readings) -> Series by replicate
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

import wsnsim.bounds as bounds
from wsnsim.analysis.frames import read
from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data, measured
from wsnsim.papers.reproduction import BoundBeside

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
