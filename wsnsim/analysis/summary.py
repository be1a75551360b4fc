"""A run in figures: what was measured, beside what the paper printed and what is possible.

as_json(report, published, limit) -> dict        `summary_text.text` makes lines of it

`published` may hold 'rmse' (in the position's unit), 'energy' (J), 'clusters', and 'rmse_px', 'rmse_vx', ... for the
state columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.bounds import bound, bound_of_run
from wsnsim.experiment import Report

SCHEMA_VERSION = 1
NAN = float("nan")
OF_THREE = ("rmse_three", "mean_error_three", "median_error_three")
"""Columns of `tracks` of the errors that three readings or more stand behind."""


class RunBounds(NamedTuple):
    """Bounds as the time mean of the RMSE, their kind, and why there is none for all readings in range.

    `active` and `arrived` are those for the readings of the clusters' members, and for those that the head had.
    """

    rmse: float = NAN
    kind: str = ""
    reason: str = ""
    active: float = NAN
    arrived: float = NAN


NOT_COMPUTED: Final = RunBounds(reason="nobody asked")


def as_json(report: Report, published: Mapping[str, float], limit: RunBounds = NOT_COMPUTED) -> dict[str, Any]:
    """The summary as one object: SI units, NaN where a figure does not exist.

    `rmse` is the time mean of the RMSE over replicates at each step; `rmse_median` the median over replicates of each
    one's RMSE over steps and targets, which a few lost tracks do not move; `column_rmse` is the root of the mean square
    over replicates and targets, `column_rmse_median` the median over replicates. What has no estimate is passed over.
    `tracked` is the mean over replicates, `rmse_three` and its like the median over tracks; of waking, sums of a run.
    """
    errors = _errors(report)
    low, high = _interval(errors.reshape(len(report.summaries), -1, errors.shape[1]), _rmse_of_runs)
    runs = [summary.run for summary in report.summaries]
    each = np.array([run["rmse"] for run in runs], dtype=np.float64)
    median_low, median_high = _interval(each, metrics.median_error)
    return {
        "schema_version": SCHEMA_VERSION,
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(runs),
        "steps": int(max(run["steps"] for run in runs)),
        "targets": len(report.summaries[0].tracks),
        "rmse": metrics.time_mean_rmse(errors),
        "rmse_low": low,
        "rmse_high": high,
        "rmse_median": metrics.median_error(each),
        "rmse_median_low": median_low,
        "rmse_median_high": median_high,
        **_column_figures(report),
        "median_error": metrics.median_error(errors),
        "lost_fraction": metrics.lost_fraction(np.array([run["lost"] for run in runs])),
        "rmse_of_kept": _rmse_of_kept(report),
        **_cost_figures(report, runs),
        "alive": _mean(runs, "alive"),
        "runs_with_deaths": sum(math.isfinite(run["first_death"]) for run in runs),
        "first_death": _median([run["first_death"] for run in runs]),
        "half_dead": _median([run["half_dead"] for run in runs]),
        "lost_at": _median([track["lost_at"] for s in report.summaries for track in s.tracks]),
        "coverage": _mean(runs, "coverage"),
        "reacquired": float(np.mean([sum(t["reacquired"] for t in s.tracks) for s in report.summaries])),
        "late": float(np.mean([sum(t["late"] for t in s.tracks) for s in report.summaries])),
        "without_estimate": float(
            np.mean([sum(s.run["steps"] - t["reports"] for t in s.tracks) for s in report.summaries])
        ),
        "delay": metrics.median_error(np.array([t["delay"] for s in report.summaries for t in s.tracks])),
        "received": float(np.mean([sum(t["received"] for t in s.tracks) for s in report.summaries])),
        "report_delay": metrics.median_error(np.array([t["report_delay"] for s in report.summaries for t in s.tracks])),
        **{name: _mean(runs, name) for name in ("in_range", "collided", "access_failures", "retries", "awake")},
        **_followed_figures(report, errors),
        "cpu_seconds": float(sum(run["cpu_seconds"] for run in runs)),
        "wall_seconds": report.wall,
        "fingerprints": [int(run["fingerprint"]) for run in runs],
        "published": dict(published),
        "bound": limit.rmse,
        "bound_active": limit.active,
        "bound_arrived": limit.arrived,
        "bound_kind": limit.kind,
        "bound_reason": limit.reason,
    }


def bounds_of_report(report: Report) -> RunBounds:
    """The bounds along each truth of a report, on the steps that have an estimate: tight, and not strict.

    Who was active and what arrived is known of a network whose events, estimates and clusters are recorded.
    """
    kind = "per_trajectory"
    found = bound(report.scenario, range(len(report.summaries)), kind)
    if found.reason:
        return RunBounds(reason=found.reason)
    steps = found.each.shape[-1]
    errors = np.full((len(report.summaries), found.each.shape[1], steps), np.nan)
    for row, summary in zip(errors, report.summaries, strict=True):
        row[:, : summary.errors.shape[1]] = summary.errors
    limit = RunBounds(found.time_mean_at(errors), kind)
    if without_network(report) or not math.isfinite(limit.rmse):
        return limit
    active, arrived = (bound_of_run(report.out, of, kind).time_mean_at(errors) for of in ("active", "arrived"))
    return limit._replace(active=active, arrived=arrived)


def _cost_figures(report: Report, runs: list[Mapping[str, Any]]) -> dict[str, Any]:
    """What it took: energy by cause, clusters, frames, operations; NaN for what only a network has."""
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    bare = without_network(report)
    return {
        "energy": _mean(runs, "energy"),
        "joules": {cause: float(np.mean([s.joules.get(cause, 0.0) for s in report.summaries])) for cause in causes},
        "clusters": NAN if bare else float(np.mean([summary.clusters for summary in report.summaries])),
        "handovers": NAN if bare else _mean(runs, "handovers"),
        "frames_sent": _mean(runs, "frames_sent"),
        "frames_lost": NAN if bare else _mean(runs, "frames_lost"),
        "packets_sent": _mean(runs, "packets_sent"),
        "cycles": _mean(runs, "cycles"),
    }


def _followed_figures(report: Report, errors: Floats) -> dict[str, float]:
    """How much of the time targets were followed, how well where enough readings came, and who was woken for it."""
    tracks = [track for summary in report.summaries for track in summary.tracks]
    figures: dict[str, float] = {"mean_error": metrics.mean_error(errors)}
    for name in ("tracked", "tracked_three"):
        each = np.array([summary.run[name] for summary in report.summaries], dtype=np.float64)
        figures[name] = float(np.mean(each))
        figures[f"{name}_low"], figures[f"{name}_high"] = _interval(each, metrics.mean_error)
    for name in OF_THREE:
        figures[name] = metrics.median_error(np.array([track[name] for track in tracks]))
    for name in ("due", "woken", "ineffective", "ineffective_twenty", "called", "dismissed"):
        figures[name] = float(np.sum([track[name] for track in tracks])) / len(report.summaries)
    return figures


def _column_figures(report: Report) -> dict[str, dict[str, float]]:
    """The state columns' RMSE by name, over all replicates and targets, and as the median over replicates."""
    pooled, middle = {}, {}
    for i, (name, _) in enumerate(report.states):
        runs = [summary.column_rmse[:, i] for summary in report.summaries]
        pooled[name] = metrics.rmse(np.concatenate(runs))
        middle[name] = metrics.median_error(np.array([metrics.rmse(run) for run in runs]))
    return {"column_rmse": pooled, "column_rmse_median": middle}


def _rmse_of_runs(errors: Floats) -> float:
    """The time mean of the RMSE, of errors (replicates, targets, steps)."""
    return metrics.time_mean_rmse(errors.reshape(-1, errors.shape[-1]))


def without_network(report: Report) -> bool:
    """Whether the run was on a bench."""
    return report.scenario.network is not None


def _interval(rows: Floats, statistic: Callable[[Floats], float]) -> tuple[float, float]:
    """The bootstrap's 95 % interval over replicates, one a row; NaN if nothing is known in any.

    Targets of one replicate share its sensors, so that they are drawn together.
    """
    return metrics.bootstrap_interval(rows, statistic) if np.isfinite(rows).any() else (NAN, NAN)


def _errors(report: Report) -> Floats:
    """(replicates * targets, steps) position errors; runs that ended earlier are filled with NaN."""
    rows = [row for summary in report.summaries for row in summary.errors]
    result = np.full((len(rows), max(len(row) for row in rows)), np.nan)
    for i, row in enumerate(rows):
        result[i, : len(row)] = row
    return result


def _rmse_of_kept(report: Report) -> float:
    errors = _errors(report)
    lost = np.array([track["lost"] for summary in report.summaries for track in summary.tracks], dtype=bool)
    return metrics.time_mean_rmse(errors[~lost]) if not lost.all() else NAN


def _mean(runs: list[Mapping[str, Any]], name: str) -> float:
    return float(np.mean([run[name] for run in runs]))


def _median(times: list[float]) -> float:
    """The median time of an event, infinite where it did not happen; NaN if in half of the cases it did not."""
    values = np.array(times)
    middle = float(np.median(np.where(np.isfinite(values), values, np.inf)))
    return middle if math.isfinite(middle) else NAN
