"""The summary of a run of a scenario for a terminal: measured values, published values and bounds.

text(report, published, source, limits) -> str
summary_of(report, published, bounds, as_json) -> str, or plain values
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from wsnsim.analysis import quantities
from wsnsim.analysis.notes import OF_THREE
from wsnsim.analysis.phrases import REASONS, aligned, wrapped
from wsnsim.analysis.quantities import CONSISTENCY_NOTE, FIGURES, ONLY_IF_NOT_ZERO, QUANTITIES, beside, bound_name
from wsnsim.analysis.summary import NOT_COMPUTED, RunBounds, as_json, bounds_of_report, clock_figures, without_network
from wsnsim.base.errors import counted
from wsnsim.base.results import Report
from wsnsim.base.tables import ONE_IS_BEST, UNLABELLED
from wsnsim.bounds.least_errors import KNOWN_ASSOCIATION
from wsnsim.scenario import resolved

SummaryRow = tuple[str, str, str]
"""The name of a quantity, its measured value, and its published value."""
Rows = Iterator[SummaryRow]
Published = Mapping[str, float]
PublishedLookup = Callable[[Mapping[str, Any]], tuple[Published, str, str]]
"""Returns the published values of a resolved scenario by quantity, the paper's name, and why runs differ from them."""
LOSS_KEYS: Final = {"ever_lost": "ever_lost", "lost_fraction": "lost"}
"""Shares of runs, each with its key in `quantities.QUANTITIES`."""
CONSISTENCY: Final = ("nees", "nees_median", "singular", "nis")
"""Quantities of consistency; singular covariances only if there are any."""
BOUND_KEYS: Final = {"bound": "in_range", "bound_active": "active", "bound_arrived": "arrived"}
TRAFFIC: Final = (
    "frames_sent", "frames_lost", "packets_sent", "packet_delivery_ratio", "collided", "retries", "access_failures",
    "cycles",
)  # fmt: skip
MOST_IN_A_ROW: Final = 80
"""Characters of the names and values of state columns that stand in one row."""
TIME_UNITS: Final = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def summary_of(
    report: Report, published: PublishedLookup, bounds: bool = False, json: bool = False
) -> str | dict[str, Any]:
    """The summary as lines, or as plain values.

    Args:
        report: what `experiment.run` returned.
        published: gives the published values of a scenario.
        bounds: whether all three bounds of the error are computed.
        json: whether plain values are wanted.
    """
    values, *paper = published(resolved(report.scenario)) if report.states else ({}, "", "")
    limits = bounds_of_report(report, bounds)
    return as_json(report, values, limits) if json else text(report, values, (paper[0], paper[1]), limits)


def text(
    report: Report,
    published: Published | None = None,
    source: tuple[str, str] = ("the paper", ""),
    limits: RunBounds = NOT_COMPUTED,
) -> str:
    """The summary as lines for a terminal: the answer in a sentence, then what it is of, and the table.

    Args:
        report: what `experiment.run` returned.
        published: published values, see `summary`.
        source: the paper that they are from, and why runs differ from it.
        limits: the bounds beside the errors.
    """
    figures = as_json(report, published or {}, limits)
    unit = report.states[report.position[0]][1] if report.states else ""
    rows = _SummaryRows(figures, published or {}, unit, report)
    lines = _lines_of_target(rows, source, limits) if report.states else aligned(list(rows.without_target()))
    what = counted(figures["steps"], "step") if report.states else f"{figures['duration']:g} s of {_frames(report)}"
    heading = (
        f"{figures['name']}: {counted(figures['replicates'], 'Monte Carlo run')} of {what}, seed {figures['seed']}"
        f" → {figures['file']}"
    )
    cpu = QUANTITIES["cpu_seconds"]
    took = (
        f"  took {figures['wall_seconds']:.1f} s; {cpu.name} {cpu.text(figures['cpu_seconds'] / figures['replicates'])}"
    )
    return "\n".join([*wrapped(figures["answer"]), *wrapped(heading, indent="  "), *lines, took])


def _frames(report: Report) -> str:
    """What a run without targets sends."""
    return "beacons" if report.scenario.workload.kind == "beacons" else "frames"


def _lines_of_target(summary: _SummaryRows, source: tuple[str, str], limits: RunBounds) -> list[str]:
    """The table of a run with targets, and the notes below it."""
    figures = summary.figures
    rows = [("", "measured", f"published ({source[0]})" if summary.published else ""), *summary.tracks()]
    rows += summary.accuracy(limits.every)
    rows += [*summary.losses(), *summary.tracking(), *summary.latency()]
    if without_network(summary.report):
        rows += summary.load()
    else:
        rows += [*summary.energy(), *summary.network(), *summary.lifetime(), *summary.clocks()]
    table = aligned([row[:2] for row in rows])
    lines = [f"{line}  {row[2]}".rstrip() for line, row in zip(table, rows, strict=True)]
    notes = [f"published: {source[1]}"] if summary.published and source[1] else []
    notes += [quantities.BOUND_NOTE] if limits.every and math.isfinite(figures["bound"]) else []
    known = math.isfinite(figures.get("bound_localisation", math.nan))
    notes += [f"least localisation: {KNOWN_ASSOCIATION}"] if known else []
    notes += [CONSISTENCY_NOTE] if any(math.isfinite(figures[key]) for key in ONE_IS_BEST) else []
    notes += [] if figures["bound_reason"] in ("", NOT_COMPUTED.reason) else [f"no bound: {figures['bound_reason']}"]
    notes += [f"note: {note}" for note in figures["notes"]]
    return lines + [line for note in notes for line in wrapped(note, "  ")]


@dataclass(frozen=True)
class _SummaryRows:
    """The rows of the table, by what they are about: the figures of `summary.as_json` in their cells."""

    figures: Mapping[str, Any]
    published: Published
    unit: str
    report: Report

    def cell(self, key: str) -> str:
        """The value of a figure with its unit."""
        return FIGURES[key].text(self.figures[key], self.unit)

    def row(self, key: str, when: bool = True, cell: str = "", after: str = "", pattern: str = "") -> Rows:
        """The row of a figure, with its interval if there is one; no row unless `when`.

        Args:
            key: of the figure.
            when: whether there is a row.
            cell: what stands in place of its value.
            after: what stands behind it.
            pattern: how a published value is written, if the paper has one.
        """
        if when:
            ends = (self.figures.get(f"{key}{end}", math.nan) for end in ("_low", "_high"))
            more = beside(
                key, self.figures.get("medians", {}), self.figures.get("nees_median_consistent", 0.0), self.unit
            )
            cell = cell or "  ".join(filter(None, [self.cell(key), FIGURES[key].interval_text(*ends), more]))
            yield quantities.name_of(key, self.figures["replicates"]), cell + after, self.printed(key, pattern)

    def printed(self, key: str, pattern: str) -> str:
        """The published value; empty if there is none."""
        return pattern.format(self.published[key]).rstrip() if pattern and key in self.published else ""

    def tracks(self) -> Rows:
        """How tracks of which no reading says whose they are follow the targets; nothing where readings say so."""
        for key in UNLABELLED if "gospa" in self.figures else ():
            yield from self.row(key)
            if key == "gospa_localisation":
                yield from self.row("bound_localisation", math.isfinite(self.figures["bound_localisation"]))

    def accuracy(self, bounds: bool) -> Rows:
        """Errors, bounds beside them if they are wanted, and consistency."""
        figures, error = self.figures, QUANTITIES["rmse"]
        missing, steps = figures["without_estimate"], figures["present_steps"]
        after = f"  (of {steps - missing:,.4g} of {steps:,.10g} steps)" * bool(missing)
        yield from self.row("rmse", after=after, pattern=f"{error.form} {self.unit}")
        yield from self.row("rmse_of_kept", figures["lost_fraction"] > 0 and math.isfinite(figures["rmse_of_kept"]))
        for key, readings in BOUND_KEYS.items():
            if bounds and math.isfinite(figures[key]):
                yield f"  {bound_name(readings, figures['faults'])}", self.cell(key), ""
        yield from self.row("rmse_median", figures["replicates"] > 1)
        yield from self.row("median_error")
        yield from self.columns()
        for key in CONSISTENCY:
            yield from self.row(key, figures[key] > 0.0)

    def columns(self) -> Rows:
        """The RMSE of the state columns in one row, or in one row each if the paper prints one of them."""
        measured, units = self.figures["column_rmse"], dict(self.report.states)
        cell = {name: FIGURES["column_rmse"].text(rmse) for name, rmse in measured.items()}
        cell = {name: f"{text} {units[name]}".rstrip() if text != "unknown" else text for name, text in cell.items()}
        short = len(", ".join([*cell, *cell.values()])) < MOST_IN_A_ROW
        if short and not any(f"rmse_{name}" in self.published for name in cell):
            yield f"RMSE of {', '.join(cell)}", ", ".join(cell.values()), ""
            return
        for name, value in cell.items():
            yield f"RMSE of {name}", value, self.printed(f"rmse_{name}", f"{{:.4g}} {units[name]}")

    def losses(self) -> Rows:
        """In how many runs a track was lost at any time and at the end, how often and for how long, by which rule."""
        figures, runs = self.figures, self.figures["replicates"]
        for key, name in LOSS_KEYS.items():
            if math.isfinite(figures[key]):
                share, count = QUANTITIES[name].text(figures[key]), round(figures[key] * runs)
                yield QUANTITIES[name].name, f"{share} ({count} of {counted(runs, 'run')})", ""
        if figures["ever_lost"] > 0.0:
            cell = f"{self.cell('losses')}, {self.cell('time_lost')} ({self.cell('lost_share')} of the steps)"
            yield "  losses of a run, time lost", cell, ""
        for key in ("lost_limit", "lost_window"):
            yield from self.row(key, math.isfinite(figures[key]))

    def tracking(self) -> Rows:
        """How much of the time targets were tracked, which nodes were woken for it; nothing if always, and no node."""
        figures = self.figures
        if not (figures["awake"] < 1.0 or figures["tracked"] < 1.0):
            return
        yield from self.row("mean_error", math.isfinite(figures["mean_error"]))
        if math.isfinite(figures["rmse_three"]):
            rmse, mean, middle = map(self.cell, OF_THREE)
            yield "  at a run's steps with three readings", f"RMSE {rmse}, mean {mean}, median {middle}", ""
        yield from self.row("tracked")
        yield from self.row("tracked_three")
        yield from self.row("awake", figures["awake"] < 1.0)
        steps = figures["steps"] * figures["targets"]
        pairs = {"woken": ("unnecessary wake-ups", "ineffective"), "called": ("dismissed", "dismissed")}
        for key, (name, other) in pairs.items():
            if figures[key]:
                cell = f"{figures[key] / steps:.3g} per step, {figures[other] / steps:.3g} per step"
                yield f"nodes {key}, {name}", cell, ""
                yield from self.row("ineffective_twenty", key == "woken")

    def latency(self) -> Rows:
        """What was late or missing, and what the sink received; only what happened."""
        figures = self.figures
        for key in ("reacquired", "without_estimate"):
            yield from self.row(key, bool(figures[key]))
        late = figures["late"] - figures["without_estimate"]
        if late > 0:
            yield "late estimates", f"{late:.4g}", ""
        yield from self.row("delay", figures["delay"] > 0.0)
        if figures["received"] or figures["due"]:
            yield "estimates received at the sink", f"{figures['received']:.4g} of {figures['due']:.4g}", ""
        yield from self.row("report_delay", bool(figures["received"]))

    def energy(self) -> Rows:
        """The energy, and what it was spent on."""
        yield from self.row("energy", pattern="{:.2f} J")
        for cause, joules in self.figures["joules"].items():
            yield f"  {cause.replace('_', ' ')}", QUANTITIES["energy"].text(joules), ""

    def network(self) -> Rows:
        """Clusters, traffic and what was lost of it; failures only if there were any."""
        for key in ("radio_on", "hurried"):
            yield from self.row(key, math.isfinite(self.figures[key]))
        yield from self.row("clusters", cell=f"{self.figures['clusters']:.4g}", pattern="{:.0f}")
        for key in TRAFFIC:
            yield from self.row(key, bool(self.figures[key]) or key not in ONLY_IF_NOT_ZERO)

    def lifetime(self) -> Rows:
        """When nodes died and how many are left; nothing if none died."""
        figures = self.figures
        if figures["runs_with_deaths"]:
            yield "runs in which nodes died", f"{figures['runs_with_deaths']} of {figures['replicates']}", ""
            for key in ("first_death", "half_dead", "lost_at"):
                yield from self.row(key, cell="" if math.isfinite(figures[key]) else "not in half of the runs")
            yield from self.row("alive")
            yield from self.row("coverage")

    def clocks(self) -> Rows:
        """How far clocks are off; nothing where clocks were not recorded or show the true time."""
        figures = self.figures if "clock_error" in self.figures else clock_figures(self.report)
        if not figures["clock_error_max"] > 0.0:
            return
        for key, name in (("error", "true time"), ("spread", "their mean")):
            middle, most = (_seconds(figures[f"clock_{key}{end}"]) for end in ("", "_max"))
            yield f"clocks from {name} at the end", f"{middle}, at most {most}", ""
        share = FIGURES["clock_synchronised"]
        if figures["clock_synchronised"] > 0.0:
            yield share.name, share.text(figures["clock_synchronised"]), ""

    def load(self) -> Rows:
        """What a network would have to carry and compute for a run without one."""
        packets, cycles, steps = (
            sum(summary.run[name] for summary in self.report.summaries) for name in ("packets_sent", "cycles", "steps")
        )
        yield "load on a network, per step", f"{packets / steps:,.4g} packets, {cycles / steps:,.0f} operations", ""

    def without_target(self) -> Iterator[tuple[str, str]]:
        """The rows of a run without targets: reports, receptions, links, clocks and energy."""
        for rows in (self.reports(), self.radio(), self.links(), self.clocks(), self.energy(), self.row("alive")):
            yield from (row[:2] for row in rows)

    def reports(self) -> Rows:
        """What became of reports to sinks; nothing if none was sent."""
        figures = self.figures
        if not figures["reports"]:
            return
        yield from self.row("reports")
        yield from self.row("received_share")
        if figures["sinks"]:
            for sink, count in figures["sinks"].items() if len(figures["sinks"]) > 1 else ():
                yield f"  at node {sink}", f"{count:,.4g}", ""
            yield from self.row("report_delay", cell=f"{1e3 * figures['report_delay']:.4g} ms")
            yield from self.row("hops")
        for reason, count in figures["dropped"].items():
            yield f"dropped: {REASONS[reason]}", f"{count:,.4g}", ""

    def radio(self) -> Rows:
        """What was sent, and what became of it."""
        figures, ratio = self.figures, QUANTITIES["packet_delivery_ratio"]
        yield f"{_frames(self.report)} sent", self.cell("frames_sent"), ""
        for key in ("access_failures", "in_range", "delivered"):
            yield from self.row(key)
        yield ratio.name, ratio.text(figures["delivered_share"]), ""
        yield from self.row("collided", after=f" ({ratio.text(figures['collided_share'])})")
        otherwise = round(figures["in_range"] - figures["delivered"] - figures["collided"])
        yield "receptions lost to fading or dead nodes", f"{otherwise:,}", ""
        yield from self.row("over_weak_links", figures["over_weak_links"] > 0)

    def links(self) -> Rows:
        """Neighbours and used links; nothing if links were not recorded."""
        if not math.isnan(self.figures["links"]):
            yield from self.row("neighbours")
            yield "links with a reception", f"{self.figures['found_share']:.2%} of {self.figures['links']:,.0f}", ""


def _seconds(time: float) -> str:
    """A time in the largest unit of which it is at least one."""
    size, unit = next(((size, unit) for size, unit in TIME_UNITS if time >= size), TIME_UNITS[-1])
    return f"{time / size:.3g} {unit}"
