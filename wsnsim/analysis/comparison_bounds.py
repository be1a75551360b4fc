"""The bound beside the errors of a campaign: how small they could be, on the truths that were simulated.

with_bounds(compared, folder) -> compared, with the columns `bound` and `bound_unconditional`
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from wsnsim.analysis import campaigns
from wsnsim.analysis.comparison import Comparison
from wsnsim.base.errors import WsnsimError
from wsnsim.bounds import bound
from wsnsim.recording.folder import Folder

MOST: Final = 100
"""Replicates whose truths are looked at: more change the third digit."""
BOUNDED: Final = ("rmse",)


class PointBounds(NamedTuple):
    """Of a world: the median over truths of the bound along each, the unconditional one, and why there is none."""

    each: float
    unconditional: float
    reason: str


def with_bounds(found: Comparison, folder: Folder) -> Comparison:
    """The same figures with the bound for all readings in range, where the metric is the error of a run.

    `bound` is the median over the replicates that are there (100 at most) of the bound along each truth, as a root mean
    square over all steps: tight, and not strict, nor for a run that has no estimate at its hard steps.
    `bound_unconditional` is strict for the mean over truths, and often loose. A point without a bound has NaN, and
    `unbounded` says why.
    """
    if found.metric not in BOUNDED:
        return found
    manifest, known = folder.manifest(), {}
    limits = []
    for number in found.table[campaigns.POINT]:
        point = manifest.points[int(number)]
        there = tuple(sorted(n for n in folder.done(point.id) if n < point.replicates)[:MOST])
        scenario = json.loads(folder.scenario(point.id))
        key = point.world, there, repr(scenario.get("tracker", {}).get("assumes"))
        if key not in known:
            known[key] = _point_bounds(scenario, there)
        limits.append(known[key])
    table = found.table.assign(
        bound=np.array([limit.each for limit in limits], dtype=np.float64),
        bound_unconditional=np.array([limit.unconditional for limit in limits], dtype=np.float64),
    )
    reasons = dict.fromkeys(limit.reason for limit in limits if limit.reason)
    return dataclasses.replace(found, table=table, unbounded="; ".join(reasons))


def _point_bounds(scenario: dict[str, object], replicates: Sequence[int]) -> PointBounds:
    nothing = float("nan")
    try:
        each, whole = (bound(scenario, replicates, kind) for kind in ("per_trajectory", "unconditional"))
    except WsnsimError as error:  # a point of which no replicate can be run has no bound either
        return PointBounds(nothing, nothing, str(error))
    return PointBounds(
        float(np.median(each.of_replicates)) if not each.reason else nothing,
        float(whole.of_replicates[0]) if not whole.reason else nothing,
        each.reason,
    )
