"""Cramér-Rao bounds beside the errors of a result file, and of a campaign.

    found_bound(path, readings, plugins) -> Bound or None        time_averages(path) -> {readings: bound, ...}
    with_bounds(comparison, folder) -> comparison with the columns `bound` and `bound_unconditional`

The trajectory-conditional CRLBs are tight but not strict bounds, see `wsnsim.bounds`. A file without a scenario, of
another version, or of a motion model without a bound has none; no error is raised. A file that names a plug-in has
none either, unless `plugins` allows importing it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis import campaigns
from wsnsim.analysis.comparison import Comparison
from wsnsim.analysis.multi_target import followed_runs, is_unlabelled
from wsnsim.analysis.plot_data import stored_json
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import WsnsimError
from wsnsim.base.runs import tracked
from wsnsim.bounds import READINGS, Bound, bound, bound_of_run
from wsnsim.recording import read_table, tables
from wsnsim.recording.folder import Folder
from wsnsim.recording.kept import KEPT, KeptAnswers
from wsnsim.scenario import Plugins, load, plugins
from wsnsim.scenario.build import leaves
from wsnsim.scenario.check import digest_or_nothing
from wsnsim.scenario.registry import refused


def lacking(path: str | Path, plugins: bool = False) -> str:
    """Why there is no bound, if the result's scenario needs a plug-in that is not imported; '' otherwise."""
    why = refused(stored_json(path, "scenario/resolved_json"), Plugins.ANY if plugins else Plugins.NONE)
    return f"the bound {why.partition(': ')[2]}" if why else ""


def time_averages(path: str | Path, plugins: bool = False) -> dict[str, float]:
    """The time average of each bound over the steps that have an estimate, in the position's unit.

    Without recorded events, or without a network, the only one is that for all readings in range.
    """
    log = tables(path).get("events")
    known = READINGS if log is not None and log.rows and not is_unlabelled(path) else ("in_range",)
    found = {readings: bound for readings in known if (bound := found_bound(path, readings, plugins)) is not None}
    means = {readings: bound.time_mean_at(errors_at(path, bound)) for readings, bound in found.items()}
    return {readings: mean for readings, mean in means.items() if np.isfinite(mean)}


def found_bound(path: str | Path, readings: str, plugins: bool) -> Bound | None:
    """The bound for these readings; None if there is none."""
    try:
        found = bound_of_run(path, readings, plugins=plugins)
    except WsnsimError:
        return None
    return None if found.reason else found


def errors_at(path: str | Path, found: Bound) -> Floats:
    """(replicates, targets, steps) errors at the bound's steps, NaN where there is no estimate.

    Where readings name no target, they are those of the tracks that follow the targets.
    """
    errors = np.full(found.each.shape, np.nan)
    if is_unlabelled(path):
        for run in followed_runs(path):
            errors[found.query.replicates.index(run.replicate), :, : run.followed.shape[1]] = run.errors
        return errors
    table = read_table(path, "estimates", ["replicate", "target", "step", "error"])
    rows = np.searchsorted(found.query.replicates, table["replicate"])
    errors[rows, table["target"], table["step"] - 1] = table["error"]
    return errors


MOST: Final = 100
"""Runs whose trajectories count at most: more change only the third digit."""


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
    if found.metric != "rmse":
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
    named = (value for key, value in leaves(scenario) if key.rpartition(".")[2] == "path" and isinstance(value, str))
    return {path: digest_or_nothing(path) for path in named}


def _point_bounds(scenario: dict[str, object], replicates: Sequence[int], allowed: Plugins) -> PointBounds:
    try:
        loaded = load(scenario, plugins=allowed)
        each, whole = (bound(loaded, replicates, kind) for kind in ("per_trajectory", "unconditional"))
    except WsnsimError as error:  # a point that cannot be run has no bound either
        return PointBounds(math.nan, math.nan, str(error))
    return PointBounds(
        float(np.median(each.of_replicates)) if not each.reason else math.nan,
        float(whole.of_replicates[0]) if not whole.reason else math.nan,
        each.reason,
        tuple(dict.fromkeys((*each.of_readings, *whole.of_readings))),
    )
