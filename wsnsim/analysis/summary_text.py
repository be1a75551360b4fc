"""A run in figures for a terminal: what was measured, beside what the paper printed, and what is possible.

text(report, published, source, limit) -> str
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from wsnsim.analysis import recorded_bounds
from wsnsim.analysis.summary import NOT_COMPUTED, OF_THREE, RunBounds, as_json, without_network
from wsnsim.experiment import Report

Row = tuple[str, str, str]
"""What it is, what was measured, what the paper printed."""
BOUNDS: Final = {
    "bound": recorded_bounds.WORDS["in_range"],
    "bound_active": recorded_bounds.WORDS["active"],
    "bound_arrived": recorded_bounds.WORDS["arrived"],
}


def text(
    report: Report, published: Mapping[str, float], source: str = "the paper", limit: RunBounds = NOT_COMPUTED
) -> str:
    """The summary as lines for a terminal."""
    figures = as_json(report, published, limit)
    heading = (
        f"{figures['name']}: {_count(figures['replicates'], 'replicate')} of {_count(figures['steps'], 'step')},"
        f" seed {figures['seed']} → {figures['file']}"
    )
    rows = [("", "measured", f"published ({source})" if published else "")]
    rows += _accuracy_rows(figures, published, report)
    if without_network(report):
        rows += _load_rows(report)
    else:
        rows += _energy_rows(figures, published) + _network_rows(figures, published)
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]}".rstrip() for row in rows]
    replicates = figures["replicates"]
    took = f"  took {figures['wall_seconds']:.1f} s, {figures['cpu_seconds'] / replicates:.2f} s of CPU a replicate"
    if figures["bound_reason"] not in ("", NOT_COMPUTED.reason):
        lines.append(f"  no bound: {figures['bound_reason']}")
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
    rows[1:1] = [
        (f"  {words}", f"{figures[name]:.4f}{unit}", "")
        for name, words in BOUNDS.items()
        if math.isfinite(figures[name])
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


def _seconds(time: float) -> str:
    """A delay as one reads it."""
    return f"{1000 * time:.3g} ms" if time < 1.0 else f"{time:.3g} s"


def _when(time: float) -> str:
    return f"{time:.2f} s" if math.isfinite(time) else "not in half of the runs"


def _published(published: Mapping[str, float], name: str, pattern: str) -> str:
    return pattern.format(published[name]) if name in published else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
