"""A run in figures, for the terminal and for programs: what was measured, beside what the paper printed.

text(report, published) -> str        as_json(report, published) -> dict

`published` may hold 'rmse' (in the position's unit), 'energy' (J), 'clusters', and 'rmse_px', 'rmse_vx', ... for the
state columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.experiment import Report

SCHEMA_VERSION = 1
NAN = float("nan")
OF_THREE = ("rmse_three", "mean_error_three", "median_error_three")
"""Columns of `tracks` of the errors that three readings or more stand behind."""
Row = tuple[str, str, str]
"""What it is, what was measured, what the paper printed."""


def as_json(report: Report, published: Mapping[str, float]) -> dict[str, Any]:
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
    }


def _cost_figures(report: Report, runs: list[Mapping[str, Any]]) -> dict[str, Any]:
    """What it took: energy by cause, clusters, frames, operations; NaN for what only a network has."""
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    bare = _without_network(report)
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


def text(report: Report, published: Mapping[str, float], source: str = "the paper") -> str:
    """The summary as lines for a terminal."""
    figures = as_json(report, published)
    heading = (
        f"{figures['name']}: {_count(figures['replicates'], 'replicate')} of {_count(figures['steps'], 'step')},"
        f" seed {figures['seed']} → {figures['file']}"
    )
    rows = [("", "measured", f"published ({source})" if published else "")]
    rows += _accuracy_rows(figures, published, report)
    if _without_network(report):
        rows += _load_rows(report)
    else:
        rows += _energy_rows(figures, published) + _network_rows(figures, published)
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]}".rstrip() for row in rows]
    replicates = figures["replicates"]
    took = f"  took {figures['wall_seconds']:.1f} s, {figures['cpu_seconds'] / replicates:.2f} s of CPU a replicate"
    return "\n".join([heading, *lines, took])


def _accuracy_rows(figures: Mapping[str, Any], published: Mapping[str, float], report: Report) -> list[Row]:
    unit = _spaced(report.states[report.position[0]][1])
    rows = [
        (
            "RMSE, mean over time",
            f"{figures['rmse']:.4f}{unit}{_bounds(figures, 'rmse')}{_of_steps(figures)}",
            _published(published, "rmse", "{:.4f}" + unit),
        ),
        ("RMSE of a run, median", f"{figures['rmse_median']:.4f}{unit}{_bounds(figures, 'rmse_median')}", ""),
        ("median error", f"{figures['median_error']:.4f}{unit}", ""),
        *_column_rows(figures["column_rmse"], published, dict(report.states)),
    ]
    if figures["lost_fraction"] > 0 and math.isfinite(figures["rmse_of_kept"]):
        rows.insert(1, ("  of tracks kept", f"{figures['rmse_of_kept']:.4f}{unit}", ""))
    lost = round(figures["lost_fraction"] * figures["replicates"])
    rows += _followed_rows(figures, unit)
    rows.append(("runs with a track lost", f"{lost} of {figures['replicates']}", ""))
    for key, name in (("reacquired", "re-acquisitions"), ("without_estimate", "steps without an estimate")):
        if figures[key]:
            rows.append((name, f"{figures[key]:.4g}", ""))
    if figures["late"] > figures["without_estimate"]:
        late = figures["late"] - figures["without_estimate"]
        rows.append(("estimates that missed their step", f"{late:.4g}, median delay {_seconds(figures['delay'])}", ""))
    if figures["received"] or figures["due"]:
        told = f"{figures['received']:.4g} of {figures['due']:.4g}"
        told += f", median delay {_seconds(figures['report_delay'])}" if figures["received"] else ""
        rows.append(("estimates that reached the sink", told, ""))
    return rows


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


def _followed_rows(figures: Mapping[str, Any], unit: str) -> list[Row]:
    """Where a network sleeps, or does not follow its target all the time: how much of it, and who was woken for it."""
    if not (figures["awake"] < 1.0 or figures["tracked"] < 1.0):
        return []
    rows = []
    if math.isfinite(figures["mean_error"]):
        rows.append(("mean error", f"{figures['mean_error']:.4f}{unit}", ""))
    if math.isfinite(figures["rmse_three"]):
        rmse, mean, middle = (f"{figures[name]:.4f}{unit}" for name in OF_THREE)
        rows.append(("  of a run's steps with three readings", f"RMSE {rmse}, mean {mean}, median {middle}", ""))
    rows += [
        ("steps tracked, by one reading or more", _share(figures, "tracked"), ""),
        ("  by three or more", _share(figures, "tracked_three"), ""),
    ]
    if figures["delay"] > 0.0:
        rows.append(("delay to the head, median", _seconds(figures["delay"]), ""))
    if figures["awake"] < 1.0:
        rows.append(("nodes awake", f"{100.0 * figures['awake']:.1f} % of the time", ""))
    if figures["woken"]:
        steps = figures["steps"] * figures["targets"]
        woken, vain = figures["woken"] / steps, figures["ineffective"] / steps
        rows.append(("nodes told to track, ineffective", f"{woken:.3g} a step, {vain:.3g} a step", ""))
        rows.append(("  ineffective in the first 20 steps", f"{figures['ineffective_twenty']:.4g}", ""))
    if figures["called"]:
        called, vain = (figures[name] / (figures["steps"] * figures["targets"]) for name in ("called", "dismissed"))
        rows.append(("nodes called, dismissed again", f"{called:.3g} a step, {vain:.3g} a step", ""))
    return rows


def _share(figures: Mapping[str, Any], name: str) -> str:
    low, high = figures[f"{name}_low"], figures[f"{name}_high"]
    bounds = f"  [{100.0 * low:.1f}, {100.0 * high:.1f}]" if math.isfinite(low) else ""
    return f"{100.0 * figures[name]:.1f} %{bounds}"


def _column_rows(measured: Mapping[str, float], published: Mapping[str, float], units: Mapping[str, str]) -> list[Row]:
    """The RMSE of the state columns in one row; in one row each where the paper prints one of them."""
    said = {name: f"{value:.4g}{_spaced(units[name])}" for name, value in measured.items()}
    if not any(f"rmse_{name}" in published for name in said):
        return [(f"RMSE of {', '.join(said)}", ", ".join(said.values()), "")]
    return [
        (f"RMSE of {name}", value, _published(published, f"rmse_{name}", "{:.4g}" + _spaced(units[name])))
        for name, value in said.items()
    ]


def _energy_rows(figures: Mapping[str, Any], published: Mapping[str, float]) -> list[Row]:
    rows = [("energy of the network", f"{figures['energy']:.4f} J", _published(published, "energy", "{:.2f} J"))]
    rows += [(f"  {cause.replace('_', ' ')}", f"{joules:.4f} J", "") for cause, joules in figures["joules"].items()]
    return rows


def _network_rows(figures: Mapping[str, Any], published: Mapping[str, float]) -> list[Row]:
    rows = [
        ("clusters", f"{figures['clusters']:.4g}", _published(published, "clusters", "{:.0f}")),
        ("frames sent / lost", f"{figures['frames_sent']:,.0f} / {figures['frames_lost']:,.0f}", ""),
        ("packets sent", f"{figures['packets_sent']:,.0f}", ""),
        *_radio_rows(figures),
        ("operations computed", f"{figures['cycles']:,.0f}", ""),
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


def _radio_rows(figures: Mapping[str, Any]) -> list[Row]:
    """What went wrong on the air, where something did."""
    named = (("collided", "receptions lost to collisions"), ("retries", "frames sent again"),
             ("access_failures", "frames that never got the channel"))  # fmt: skip
    return [(words, f"{figures[name]:,.0f}", "") for name, words in named if figures[name]]


def _load_rows(report: Report) -> list[Row]:
    """What a network would have to carry and compute for a run that had none."""
    packets, cycles, steps = (
        sum(summary.run[name] for summary in report.summaries) for name in ("packets_sent", "cycles", "steps")
    )
    return [("load of a network, a step", f"{packets / steps:,.4g} packets, {cycles / steps:,.0f} operations", "")]


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


def _without_network(report: Report) -> bool:
    return report.scenario.network is not None


def _interval(rows: Floats, statistic: Callable[[Floats], float]) -> tuple[float, float]:
    """The bootstrap's 95 % interval over replicates, one a row; NaN if nothing is known in any.

    Targets of one replicate share its sensors, so that they are drawn together.
    """
    return metrics.bootstrap_interval(rows, statistic) if np.isfinite(rows).any() else (NAN, NAN)


def _of_steps(figures: Mapping[str, Any]) -> str:
    """Of how many steps an accuracy is, where steps are missing: those have no error that could be counted."""
    missing, steps = figures["without_estimate"], figures["steps"] * figures["targets"]
    return f"  (of {steps - missing:,.4g} of {steps:,} steps)" if missing else ""


def _bounds(figures: Mapping[str, Any], name: str) -> str:
    low, high = figures[f"{name}_low"], figures[f"{name}_high"]
    return f"  [{low:.3f}, {high:.3f}]" if math.isfinite(low) else ""


def _spaced(unit: str) -> str:
    """A unit as it follows a number; nothing where there is none."""
    return f" {unit}" if unit else ""


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


def _seconds(time: float) -> str:
    """A delay as one reads it."""
    return f"{1000 * time:.3g} ms" if time < 1.0 else f"{time:.3g} s"


def _when(time: float) -> str:
    return f"{time:.2f} s" if math.isfinite(time) else "not in half of the runs"


def _published(published: Mapping[str, float], name: str, pattern: str) -> str:
    return pattern.format(published[name]) if name in published else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
