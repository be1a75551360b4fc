"""The summary of a run of a scenario for a terminal: measured values, published values and bounds.

text(report, published, source, limits) -> str
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from wsnsim.analysis import answer_facts
from wsnsim.analysis.phrases import counted, wrapped
from wsnsim.analysis.quantities import BOUND_NOTE, CONSISTENCY_NOTE, ONLY_IF_NOT_ZERO, QUANTITIES, beside, bound_name
from wsnsim.analysis.summary import NOT_COMPUTED, OF_THREE, RunBounds, as_json, without_network
from wsnsim.base.results import Report
from wsnsim.base.tables import ONE_IS_BEST

SummaryRow = tuple[str, str, str]
"""The name of a quantity, its measured value, and its published value."""
Figures = Mapping[str, Any]
Published = Mapping[str, float]
LOSS_KEYS: Final = {"ever_lost": "ever_lost", "lost_fraction": "lost"}
"""Shares of runs, each with its key in `quantities.QUANTITIES`."""
CONSISTENCY: Final = ("nees", "nees_median", "singular", "nis")
"""Quantities of consistency; singular covariances only if there are any."""
BOUND_KEYS: Final = {"bound": "in_range", "bound_active": "active", "bound_arrived": "arrived"}


def text(report: Report, published: Published, source: str = "the paper", limits: RunBounds = NOT_COMPUTED) -> str:
    """The summary as lines for a terminal: the answer in a sentence, then what it is of, and the table.

    Args:
        report: what `experiment.run` returned.
        published: published values, see `summary`.
        source: the paper that they are from.
        limits: the bounds beside the errors.
    """
    figures = as_json(report, published, limits)
    replicates, unit = figures["replicates"], report.states[report.position[0]][1]
    heading = (
        f"{figures['name']}: {counted(replicates, 'Monte Carlo run')} of {counted(figures['steps'], 'step')},"
        f" seed {figures['seed']} → {figures['file']}"
    )
    rows = [("", "measured", f"published ({source})" if published else "")]
    rows += (
        _accuracy_rows(figures, published, report, limits.every)
        + _tracking_rows(figures, unit)
        + _latency_rows(figures)
    )
    if without_network(report):
        rows += _load_rows(report)
    else:
        rows += _energy_rows(figures, published) + _network_rows(figures, published) + _lifetime_rows(figures)
        rows += [(name, value, "") for name, value in answer_facts.clock_rows(answer_facts.clock_figures(report))]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]}".rstrip() for row in rows]
    if limits.every and math.isfinite(figures["bound"]):
        lines.append(f"  {BOUND_NOTE}")
    if any(math.isfinite(figures[key]) for key in ONE_IS_BEST):
        lines.append(f"  {CONSISTENCY_NOTE}")
    if figures["bound_reason"] not in ("", NOT_COMPUTED.reason):
        lines.append(f"  no bound: {figures['bound_reason']}")
    lines += [f"  note: {note}" for note in figures["notes"]]
    cpu = QUANTITIES["cpu_seconds"]
    took = f"  took {figures['wall_seconds']:.1f} s; {cpu.name} {cpu.text(figures['cpu_seconds'] / replicates, '')}"
    return "\n".join([*wrapped(figures["answer"]), heading, *lines, took])


def _row(figures: Figures, key: str, unit: str = "", printed: str = "") -> SummaryRow:
    """The row of a summary quantity, with its interval if there is one."""
    quantity = QUANTITIES[key]
    bounds = quantity.interval_text(figures.get(f"{key}_low", math.nan), figures.get(f"{key}_high", math.nan))
    more = beside(key, figures["medians"], figures["nees_median_consistent"], unit)
    return quantity.name, "  ".join(filter(None, [quantity.text(figures[key], unit), bounds, more])), printed


def _accuracy_rows(figures: Figures, published: Published, report: Report, bounds: bool) -> list[SummaryRow]:
    of, unit = QUANTITIES["rmse"], report.states[report.position[0]][1]
    name, value, printed = _row(figures, "rmse", unit, of.text(published["rmse"], unit) if "rmse" in published else "")
    rows = [(name, value + _of_steps(figures), printed)]
    if figures["lost_fraction"] > 0 and math.isfinite(figures["rmse_of_kept"]):
        rows.append(("  of tracks not lost at the end", of.text(figures["rmse_of_kept"], unit), ""))
    rows += [
        (f"  {bound_name(readings, figures['faults'])}", of.text(figures[key], unit), "")
        for key, readings in BOUND_KEYS.items()
        if bounds and math.isfinite(figures[key])
    ]
    rows += [_row(figures, "rmse_median", unit), _row(figures, "median_error", unit)]
    rows += _column_rows(figures["column_rmse"], published, dict(report.states))
    rows += [_row(figures, key) for key in CONSISTENCY if figures[key] > 0.0]
    return rows + _loss_rows(figures, unit)


def _loss_rows(figures: Figures, unit: str) -> list[SummaryRow]:
    """In how many runs a track was lost at any time and at the end, how often and for how long, and by which rule."""
    replicates, rows = figures["replicates"], []
    known = [(key, name) for key, name in LOSS_KEYS.items() if math.isfinite(figures[key])]
    for key, name in known:
        count = round(figures[key] * replicates)
        cell = f"{QUANTITIES[name].text(figures[key], '')} ({count} of {counted(replicates, 'run')})"
        rows.append((QUANTITIES[name].name, cell, ""))
    if figures["ever_lost"] > 0.0:
        losses, time, share = (QUANTITIES[key].text(figures[key], "") for key in ("losses", "time_lost", "lost_share"))
        rows.append(("  losses of a run, time lost", f"{losses}, {time} ({share} of the steps)", ""))
    return rows + [_row(figures, key, unit) for key in ("lost_limit", "lost_window") if math.isfinite(figures[key])]


def _tracking_rows(figures: Figures, unit: str) -> list[SummaryRow]:
    """How much of the time targets were tracked, and which nodes were woken for it; nothing if always, and no node."""
    if not (figures["awake"] < 1.0 or figures["tracked"] < 1.0):
        return []
    rows, error = [], QUANTITIES["rmse"]
    if math.isfinite(figures["mean_error"]):
        rows.append(("mean position error", error.text(figures["mean_error"], unit), ""))
    if math.isfinite(figures["rmse_three"]):
        rmse, mean, middle = (error.text(figures[name], unit) for name in OF_THREE)
        rows.append(("  at a run's steps with three readings", f"RMSE {rmse}, mean {mean}, median {middle}", ""))
    share = QUANTITIES["tracked"]
    three = share.text(figures["tracked_three"], "")
    bounds = share.interval_text(figures["tracked_three_low"], figures["tracked_three_high"])
    rows += [_row(figures, "tracked"), ("  with three readings or more", f"{three}  {bounds}".rstrip(), "")]
    if figures["awake"] < 1.0:
        rows.append(_row(figures, "awake"))
    steps = figures["steps"] * figures["targets"]
    if figures["woken"]:
        woken, needless = figures["woken"] / steps, figures["ineffective"] / steps
        rows.append(("nodes woken, unnecessary wake-ups", f"{woken:.3g} per step, {needless:.3g} per step", ""))
        rows.append(("  unnecessary in the first 20 steps", f"{figures['ineffective_twenty']:.4g}", ""))
    if figures["called"]:
        called, dismissed = figures["called"] / steps, figures["dismissed"] / steps
        rows.append(("nodes called, dismissed", f"{called:.3g} per step, {dismissed:.3g} per step", ""))
    return rows


def _latency_rows(figures: Figures) -> list[SummaryRow]:
    """What was late or missing, and what the sink received; only what happened."""
    named = (("reacquired", "reacquisitions"), ("without_estimate", "steps without an estimate"))
    rows = [(name, f"{figures[key]:.4g}", "") for key, name in named if figures[key]]
    late = figures["late"] - figures["without_estimate"]
    if late > 0:
        rows.append(("late estimates", f"{late:.4g}", ""))
    if figures["delay"] > 0.0:
        rows.append(_row(figures, "delay"))
    if figures["received"] or figures["due"]:
        rows.append(("estimates received at the sink", f"{figures['received']:.4g} of {figures['due']:.4g}", ""))
    if figures["received"]:
        rows.append(_row(figures, "report_delay"))
    return rows


def _column_rows(measured: Mapping[str, float], published: Published, units: Mapping[str, str]) -> list[SummaryRow]:
    """The RMSE of the state columns in one row, or in one row each if the paper prints one of them."""
    cell = {name: _column_cell(value, units[name]) for name, value in measured.items()}
    if not any(f"rmse_{name}" in published for name in cell):
        return [(f"RMSE of {', '.join(cell)}", ", ".join(cell.values()), "")]
    return [
        (f"RMSE of {name}", value, _published(published, f"rmse_{name}", f"{{:.4g}} {units[name]}".rstrip()))
        for name, value in cell.items()
    ]


def _column_cell(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".rstrip() if math.isfinite(value) else "unknown"


def _energy_rows(figures: Figures, published: Published) -> list[SummaryRow]:
    energy = QUANTITIES["energy"]
    causes = [
        (f"  {cause.replace('_', ' ')}", energy.text(joules, ""), "") for cause, joules in figures["joules"].items()
    ]
    return [_row(figures, "energy", "", _published(published, "energy", "{:.2f} J")), *causes]


def _network_rows(figures: Figures, published: Published) -> list[SummaryRow]:
    """Clusters, traffic and what was lost of it; failures only if there were any."""
    shown = ("frames_sent", "frames_lost", "packets_sent", "packet_delivery_ratio", "collided", "retries",
             "access_failures", "cycles")  # fmt: skip
    return [
        *[_row(figures, name) for name in ("radio_on", "hurried") if math.isfinite(figures[name])],
        ("clusters", f"{figures['clusters']:.4g}", _published(published, "clusters", "{:.0f}")),
        *(_row(figures, key) for key in shown if figures[key] or key not in ONLY_IF_NOT_ZERO),
    ]


def _lifetime_rows(figures: Figures) -> list[SummaryRow]:
    if not figures["runs_with_deaths"]:
        return []
    named = [(QUANTITIES[key].name, figures[key]) for key in ("first_death", "half_dead")]
    named.append(("first track loss, median", figures["lost_at"]))
    return [
        ("runs in which nodes died", f"{figures['runs_with_deaths']} of {figures['replicates']}", ""),
        *((name, f"{time:.4g} s" if math.isfinite(time) else "not in half of the runs", "") for name, time in named),
        _row(figures, "alive"),
        _row(figures, "coverage"),
    ]


def _load_rows(report: Report) -> list[SummaryRow]:
    """What a network would have to carry and compute for a run without one."""
    packets, cycles, steps = (
        sum(summary.run[name] for summary in report.summaries) for name in ("packets_sent", "cycles", "steps")
    )
    cell = f"{packets / steps:,.4g} packets, {cycles / steps:,.0f} operations"
    return [("load on a network, per step", cell, "")]


def _of_steps(figures: Figures) -> str:
    """The number of steps with an estimate, if some have none."""
    missing, steps = figures["without_estimate"], figures["steps"] * figures["targets"]
    return f"  (of {steps - missing:,.4g} of {steps:,} steps)" if missing else ""


def _published(published: Published, name: str, pattern: str) -> str:
    return pattern.format(published[name]) if name in published else ""
