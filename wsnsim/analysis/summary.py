"""A run in figures, for the terminal and for programs: what was measured, beside what the paper printed.

text(report, published) -> str        as_json(report, published) -> dict
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.experiment import Report

SCHEMA_VERSION = 1


def as_json(report: Report, published: Mapping[str, float]) -> dict[str, Any]:
    """The summary as one object: SI units, NaN where a figure does not exist."""
    errors = _errors(report)
    low, high = metrics.bootstrap_interval(errors, metrics.time_mean_rmse)
    runs = [summary.run for summary in report.summaries]
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    return {
        "schema_version": SCHEMA_VERSION,
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(runs),
        "steps": int(max(run["steps"] for run in runs)),
        "rmse": metrics.time_mean_rmse(errors),
        "rmse_low": low,
        "rmse_high": high,
        "median_error": metrics.median_error(errors),
        "lost_fraction": metrics.lost_fraction(np.array([run["lost"] for run in runs])),
        "rmse_of_kept": _rmse_of_kept(report),
        "energy": _mean(runs, "energy"),
        "joules": {cause: float(np.mean([s.joules.get(cause, 0.0) for s in report.summaries])) for cause in causes},
        "clusters": float(np.mean([summary.clusters for summary in report.summaries])),
        "handovers": _mean(runs, "handovers"),
        "frames_sent": _mean(runs, "frames_sent"),
        "frames_lost": _mean(runs, "frames_lost"),
        "packets_sent": _mean(runs, "packets_sent"),
        "alive": _mean(runs, "alive"),
        "runs_with_deaths": sum(math.isfinite(run["first_death"]) for run in runs),
        "first_death": _median([run["first_death"] for run in runs]),
        "half_dead": _median([run["half_dead"] for run in runs]),
        "lost_at": _median([track["lost_at"] for s in report.summaries for track in s.tracks]),
        "coverage": _mean(runs, "coverage"),
        "reacquired": float(np.mean([sum(t["reacquired"] for t in s.tracks) for s in report.summaries])),
        "late": float(np.mean([sum(t["late"] for t in s.tracks) for s in report.summaries])),
        "cpu_seconds": float(sum(run["cpu_seconds"] for run in runs)),
        "wall_seconds": report.wall,
        "fingerprints": [int(run["fingerprint"]) for run in runs],
        "published": dict(published),
    }


def text(report: Report, published: Mapping[str, float], source: str = "the paper") -> str:
    """The summary as lines for a terminal."""
    figures = as_json(report, published)
    heading = (
        f"{figures['name']}: {_count(figures['replicates'], 'replicate')} of {_count(figures['steps'], 'step')},"
        f" seed {figures['seed']} → {figures['file']}"
    )
    rows = [("", "measured", f"published ({source})" if published else "")]
    rows += _accuracy_rows(figures, published) + _energy_rows(figures, published) + _network_rows(figures, published)
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]}".rstrip() for row in rows]
    replicates = figures["replicates"]
    took = f"  took {figures['wall_seconds']:.1f} s, {figures['cpu_seconds'] / replicates:.2f} s of CPU a replicate"
    return "\n".join([heading, *lines, took])


def _accuracy_rows(figures: Mapping[str, Any], published: Mapping[str, float]) -> list[tuple[str, str, str]]:
    interval = ""
    if math.isfinite(figures["rmse_low"]):
        interval = f"  [{figures['rmse_low']:.3f}, {figures['rmse_high']:.3f}]"
    rows = [
        ("RMSE, mean over time", f"{figures['rmse']:.4f} m{interval}", _published(published, "rmse", "{:.4f} m")),
        ("median error", f"{figures['median_error']:.4f} m", ""),
    ]
    if figures["lost_fraction"] > 0 and math.isfinite(figures["rmse_of_kept"]):
        rows.insert(1, ("  of tracks kept", f"{figures['rmse_of_kept']:.4f} m", ""))
    lost = round(figures["lost_fraction"] * figures["replicates"])
    rows.append(("runs with a track lost", f"{lost} of {figures['replicates']}", ""))
    for key, name in (("reacquired", "re-acquisitions"), ("late", "steps late or without estimate")):
        if figures[key]:
            rows.append((name, f"{figures[key]:.4g}", ""))
    return rows


def _energy_rows(figures: Mapping[str, Any], published: Mapping[str, float]) -> list[tuple[str, str, str]]:
    rows = [("energy of the network", f"{figures['energy']:.4f} J", _published(published, "energy", "{:.2f} J"))]
    rows += [(f"  {cause.replace('_', ' ')}", f"{joules:.4f} J", "") for cause, joules in figures["joules"].items()]
    return rows


def _network_rows(figures: Mapping[str, Any], published: Mapping[str, float]) -> list[tuple[str, str, str]]:
    rows = [
        ("clusters", f"{figures['clusters']:.4g}", _published(published, "clusters", "{:.0f}")),
        ("frames sent / lost", f"{figures['frames_sent']:,.0f} / {figures['frames_lost']:,.0f}", ""),
        ("packets sent", f"{figures['packets_sent']:,.0f}", ""),
    ]
    if figures["runs_with_deaths"]:
        rows += [
            ("runs in which nodes died", f"{figures['runs_with_deaths']} of {figures['replicates']}", ""),
            ("first death, median", _when(figures["first_death"]), ""),
            ("half of the nodes dead, median", _when(figures["half_dead"]), ""),
            ("track first lost, median", _when(figures["lost_at"]), ""),
            ("nodes alive at the end", f"{figures['alive']:.4g}", ""),
            ("coverage left", f"{100 * figures['coverage']:.1f} %", ""),
        ]
    return rows


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
    return metrics.time_mean_rmse(errors[~lost]) if not lost.all() else float("nan")


def _mean(runs: list[Mapping[str, Any]], name: str) -> float:
    return float(np.mean([run[name] for run in runs]))


def _median(times: list[float]) -> float:
    """The median time of an event, infinite where it did not happen; NaN if in half of the cases it did not."""
    values = np.array(times)
    middle = float(np.median(np.where(np.isfinite(values), values, np.inf)))
    return middle if math.isfinite(middle) else float("nan")


def _when(time: float) -> str:
    return f"{time:.2f} s" if math.isfinite(time) else "not in half of the runs"


def _published(published: Mapping[str, float], name: str, pattern: str) -> str:
    return pattern.format(published[name]) if name in published else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
