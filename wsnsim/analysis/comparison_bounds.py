"""Cramér-Rao bounds beside the errors of a campaign.

with_bounds(comparison, folder) -> comparison with the columns `bound` and `bound_unconditional`
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis import campaigns
from wsnsim.analysis.comparison import Comparison
from wsnsim.base.errors import WsnsimError
from wsnsim.base.files import read_regular
from wsnsim.base.runs import tracked
from wsnsim.bounds import bound
from wsnsim.recording.folder import Folder
from wsnsim.recording.kept import KEPT, KeptAnswers
from wsnsim.scenario import Plugins, load, plugins
from wsnsim.scenario.registry import refused

MOST: Final = 100
"""Runs whose trajectories count at most: more change only the third digit."""
BOUNDED: Final = ("rmse",)


class PointBounds(NamedTuple):
    """The bounds of one point.

    Attributes:
        each: the median over runs of the trajectory-conditional CRLB.
        unconditional: the posterior CRLB.
        reason: why there is none.
        about: what they take of the readings that may be otherwise, a sentence each.
    """

    each: float
    unconditional: float
    reason: str
    about: Sequence[str] = ()


def with_bounds(found: Comparison, folder: Folder, plugins: Plugins | None = None) -> Comparison:
    """The comparison with the bounds for all readings in range, if the metric is the RMSE of a run.

    `bound` is the median over runs (100 at most) of the trajectory-conditional CRLB, each a root mean square over all
    steps: tight but not a strict bound, least of all for a run without estimates at its hard steps.
    `bound_unconditional` is the posterior CRLB: strict for the mean over trajectories, and often loose. A point without
    a bound has NaN, and `unbounded` says why. Bounds are kept beside the campaign, see `recording.kept`.
    `plugins` says which plug-ins the campaign's scenarios may name; by default none.
    """
    if found.metric not in BOUNDED:
        return found
    manifest, known = folder.manifest(), {}
    kept = KeptAnswers(folder.path / KEPT / "bounds.json")
    limits = []
    for number in tracked([int(number) for number in found.table[campaigns.POINT]], "bounds"):
        point = manifest.points[number]
        there = tuple(sorted(n for n in folder.done(point.id) if n < point.replicates)[:MOST])
        scenario = json.loads(folder.scenario(point.id))
        key = point.world, there, repr(scenario.get("tracker", {}).get("assumes"))
        if key not in known:
            known[key] = _kept_bounds(kept, scenario, there, plugins or Plugins.NONE)
        limits.append(known[key])
    table = found.table.assign(
        bound=np.array([limit.each for limit in limits], dtype=np.float64),
        bound_unconditional=np.array([limit.unconditional for limit in limits], dtype=np.float64),
    )
    reasons = dict.fromkeys(limit.reason for limit in limits if limit.reason)
    about = dict.fromkeys(sentence for limit in limits for sentence in limit.about)
    return dataclasses.replace(found, table=table, unbounded="; ".join(reasons), of_bounds="; ".join(about))


def _kept_bounds(
    kept: KeptAnswers, scenario: dict[str, object], replicates: Sequence[int], allowed: Plugins
) -> PointBounds:
    """The bounds of a point, kept beside the campaign unless they depend on code from outside the package."""
    if why := refused(scenario, allowed):
        return PointBounds(math.nan, math.nan, f"the bound {why.partition(': ')[2]}")
    with contextlib.suppress(WsnsimError):
        if not plugins(load(scenario, plugins=allowed)):
            question = {"scenario": scenario, "replicates": replicates, "files": _digests(scenario)}
            return PointBounds(*kept.answer(question, lambda: _point_bounds(scenario, replicates, allowed)))
    return _point_bounds(scenario, replicates, allowed)


def _digests(scenario: Any) -> dict[str, str]:
    """{path: digest of the content} of the files that a scenario names, by keys `path`; "" if one cannot be read."""
    inner = (
        scenario.items() if isinstance(scenario, dict) else enumerate(scenario) if isinstance(scenario, list) else ()
    )
    found: dict[str, str] = {}
    for key, value in inner:
        found |= _digests(value)
        if key == "path" and isinstance(value, str):
            try:
                found[value] = hashlib.sha256(read_regular(value)).hexdigest()
            except OSError:
                found[value] = ""
    return found


def _point_bounds(scenario: dict[str, object], replicates: Sequence[int], allowed: Plugins) -> PointBounds:
    nothing = math.nan
    try:
        loaded = load(scenario, plugins=allowed)
        each, whole = (bound(loaded, replicates, kind) for kind in ("per_trajectory", "unconditional"))
    except WsnsimError as error:  # a point that cannot be run has no bound either
        return PointBounds(nothing, nothing, str(error))
    return PointBounds(
        float(np.median(each.of_replicates)) if not each.reason else nothing,
        float(whole.of_replicates[0]) if not whole.reason else nothing,
        each.reason,
        tuple(dict.fromkeys((*each.of_readings, *whole.of_readings))),
    )
