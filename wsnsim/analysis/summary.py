"""The summary of a run of a scenario as plain values: quantities, published values and bounds.

as_json(report, published, bounds) -> dict        `summary_text.text` makes lines of it

`published` may hold 'rmse' (in the position's unit), 'energy' (J), 'clusters', and 'rmse_px', 'rmse_vx', ... for the
state columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis import notes
from wsnsim.analysis.answer import comparable, sentence
from wsnsim.analysis.answer_facts import facts_of_report
from wsnsim.analysis.quantities import QUANTITIES, ResultArrays, interval, median_time, medians
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.results import Report
from wsnsim.bounds import READINGS, bounds_of_run

SCHEMA_VERSION = 1
NAN = float("nan")
WITH_INTERVAL: Final = ("rmse", "rmse_median", "tracked", "nees", "nis")
OF_THREE: Final = ("rmse_three", "mean_error_three", "median_error_three")
"""Columns of `tracks`: errors at the steps with three readings or more."""
NETWORK_ONLY: Final = ("handovers", "frames_lost", "delivered", "packet_delivery_ratio")


class RunBounds(NamedTuple):
    """Trajectory-conditional CRLBs beside the time-averaged RMSE of a report.

    Attributes:
        rmse: for all readings in range.
        kind: the kind of bound.
        reason: why there is none.
        active: for the readings of active members.
        arrived: for the readings that arrived at the head.
        judged: for all readings in range, at the steps of the error in the answer (see `answer.answer`).
        every: whether those of active members and of the readings that arrived were asked for.
    """

    rmse: float = NAN
    kind: str = ""
    reason: str = ""
    active: float = NAN
    arrived: float = NAN
    judged: float = NAN
    every: bool = False


NOT_COMPUTED: Final = RunBounds(reason="not computed")


def as_json(report: Report, published: Mapping[str, float], limits: RunBounds = NOT_COMPUTED) -> dict[str, Any]:
    """The summary as one object: SI units, NaN for a quantity that does not exist.

    `answer` is the sentence of `answer.answer`. The quantities of `quantities.QUANTITIES` have their keys there, except
    `lost`, which is `lost_fraction` here, and `cpu_seconds`, which is the sum over runs. `column_rmse` is the root mean
    square over steps, runs and targets, `column_rmse_median` the median over runs. `rmse_three` and the like are
    medians over tracks; counts of waking are means of a run. `medians` has those over runs of means that few of them
    decide (see `quantities.medians`), `nees_median_consistent` the `nees_median` of a consistent filter. Steps without
    an estimate are left out. `faults` holds the kinds of faults, which `bound` does not count. `notes` says what a
    reader must know beside the figures, and `unknown` why each figure without a value has none.
    """
    figures = _figures(report, published, limits)
    unknown = notes.reasons(report, figures)
    if not limits.every and math.isfinite(limits.rmse) and not without_network(report):
        unknown |= dict.fromkeys(("bound_active", "bound_arrived"), notes.ON_REQUEST)
    return figures | {"notes": notes.of_report(report, figures), "unknown": unknown}


def _figures(report: Report, published: Mapping[str, float], limits: RunBounds) -> dict[str, Any]:
    """The summary without its notes."""
    arrays = result_arrays(report)
    found = {key: quantity.value(arrays) for key, quantity in QUANTITIES.items()}
    found |= dict.fromkeys(NETWORK_ONLY, NAN) if without_network(report) else {}
    for key in WITH_INTERVAL:
        found[f"{key}_low"], found[f"{key}_high"] = QUANTITIES[key].interval(arrays)
    facts = facts_of_report(report)
    return {
        "schema_version": SCHEMA_VERSION,
        "answer": sentence(facts, limits.judged),
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(report.summaries),
        "steps": int(arrays.runs["steps"].max()),
        "targets": len(report.summaries[0].tracks),
        "medians": {key: value for key, value in medians(arrays).items() if math.isfinite(found[key])},
        "nees_median_consistent": arrays.consistent,
        "lost_fraction": found.pop("lost"),
        **found,
        **_column_rmse(report),
        "rmse_of_kept": _rmse_of_kept(report, arrays.errors),
        **_energy_and_clusters(report),
        "runs_with_deaths": int(np.isfinite(arrays.runs["first_death"]).sum()),
        **_track_figures(report, arrays.errors),
        "cpu_seconds": float(arrays.runs["cpu_seconds"].sum()),
        "wall_seconds": report.wall,
        "fingerprints": [int(summary.run["fingerprint"]) for summary in report.summaries],
        "published": dict(published),
        "bound": limits.rmse,
        "bound_active": limits.active,
        "bound_arrived": limits.arrived,
        "bound_kind": limits.kind,
        "faults": list(facts.faults),
        "bound_reason": limits.reason,
    }


def result_arrays(report: Report) -> ResultArrays:
    """The arrays of a report that summary quantities are computed from."""
    rows = [summary.run for summary in report.summaries]
    columns = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in rows[0]}
    errors = _errors(report, max(summary.errors.shape[1] for summary in report.summaries))
    names = [name for quantity in QUANTITIES.values() if quantity.of_tracks for name in quantity.columns]
    tracks = {
        name: np.array([[track[name] for track in summary.tracks] for summary in report.summaries], dtype=np.float64)
        for name in names
    }
    return ResultArrays(errors, columns, bool(report.states), tracks, len(report.position))


def _errors(report: Report, steps: int) -> Floats:
    """(runs, targets, steps) position errors, NaN after the end of a run."""
    errors = np.full((len(report.summaries), len(report.summaries[0].errors), steps), np.nan)
    for row, summary in zip(errors, report.summaries, strict=True):
        row[:, : summary.errors.shape[1]] = summary.errors
    return errors


def bounds_of_report(report: Report, every: bool = False) -> RunBounds:
    """The trajectory-conditional CRLBs of a report, averaged over the steps that have an estimate.

    Args:
        report: what `experiment.run` returned.
        every: whether those of active members and of readings that arrived are computed, too. They are known of a
            network whose events, estimates and clusters were recorded, and take several times as long.
    """
    kind = "per_trajectory"
    readings = READINGS if every and not without_network(report) else READINGS[:1]
    replicates = [summary.run["replicate"] for summary in report.summaries]
    found, *of_members = bounds_of_run(report.out, readings, kind, replicates=replicates, scenario=report.scenario)
    if found.reason:
        return RunBounds(reason=found.reason, every=every)
    errors = _errors(report, found.each.shape[-1])
    judged = comparable(facts_of_report(report), found)
    limits = RunBounds(found.time_mean_at(errors), kind, judged=judged, every=every)
    if not of_members or not math.isfinite(limits.rmse):
        return limits
    active, arrived = (bound.time_mean_at(errors) for bound in of_members)
    return limits._replace(active=active, arrived=arrived)


def without_network(report: Report) -> bool:
    """Whether the run was a standalone filter, without a network."""
    return report.scenario.network is not None


def _energy_and_clusters(report: Report) -> dict[str, Any]:
    """The joules by cause, and the number of clusters, means over the runs."""
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    clusters = NAN if without_network(report) else float(np.mean([summary.clusters for summary in report.summaries]))
    return {
        "joules": {cause: float(np.mean([s.joules.get(cause, 0.0) for s in report.summaries])) for cause in causes},
        "clusters": clusters,
    }


def _track_figures(report: Report, errors: Floats) -> dict[str, float]:
    """What the table `tracks` adds: losses, latencies, steps with three readings, wake-ups."""
    tracks, runs = [track for summary in report.summaries for track in summary.tracks], len(report.summaries)

    def column(name: str) -> Floats:
        return np.array([track[name] for track in tracks], dtype=np.float64)

    def per_run(name: str) -> float:
        return float(column(name).sum()) / runs

    three = np.array([summary.run["tracked_three"] for summary in report.summaries], dtype=np.float64)
    low, high = interval(three, metrics.mean_error)
    steps = sum(summary.run["steps"] * len(summary.tracks) for summary in report.summaries) / runs
    summed = ("reacquired", "late", "received", "due", "woken", "ineffective", "ineffective_twenty", "called")
    return {
        "lost_at": median_time(column("lost_at")),
        **{name: per_run(name) for name in (*summed, "dismissed")},
        "without_estimate": steps - per_run("reports"),
        **{name: metrics.median_error(column(name)) for name in ("delay", "report_delay", *OF_THREE)},
        "mean_error": metrics.mean_error(errors),
        "tracked_three": float(np.mean(three)),
        "tracked_three_low": low,
        "tracked_three_high": high,
    }


def _column_rmse(report: Report) -> dict[str, dict[str, float]]:
    """The RMSE of each state column, over all runs and targets, and as the median over runs."""
    pooled, middle = {}, {}
    for i, (name, _) in enumerate(report.states):
        runs = [summary.column_rmse[:, i] for summary in report.summaries]
        pooled[name] = metrics.rmse(np.concatenate(runs))
        middle[name] = metrics.median_error(np.array([metrics.rmse(run) for run in runs]))
    return {"column_rmse": pooled, "column_rmse_median": middle}


def _rmse_of_kept(report: Report, errors: Floats) -> float:
    """The time-averaged RMSE of the tracks that were not lost; NaN if all were."""
    lost = np.array([[bool(track["lost"]) for track in summary.tracks] for summary in report.summaries])
    return metrics.time_mean_rmse(errors[~lost]) if not lost.all() else NAN
