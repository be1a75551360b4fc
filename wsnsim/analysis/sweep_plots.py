"""Plots of a campaign: each function draws one plot over a swept key on a matplotlib Axes and returns the Axes.

    lines = lines_of(Folder("results/particles"), "rmse", key=None)
    median(axes, lines)      energy(axes, lines)      lost(axes, lines)      differences(axes, lines)

A band is the 95 % confidence interval of its line; points that are not joined have error bars. Unknown values are gaps.
Lines of the same colour differ in dashes and marks.
"""

from __future__ import annotations

from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator

from wsnsim.analysis.figure_style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION
from wsnsim.analysis.plot_data import EMPTY, bracketed
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.sweep_lines import SweepLines, lines_of
from wsnsim.base.arrays import Floats

__all__ = ["SweepLines", "differences", "energy", "lines_of", "lost", "median"]

COLOURS: Final = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
DASHES: Final = ("-", "--", ":", "-.")
MARKS: Final = ("o", "s", "^", "D")
LOG_FROM: Final = 10.0
"""Ratio of the largest to the smallest swept value from which on the axis is logarithmic (our choice)."""
LOG_ERRORS_FROM: Final = 30.0
"""The same ratio for the drawn values of the metric."""
CLOSEST: Final = 0.045
"""Share of the axis below which two swept values are too close to be labelled both."""
MARGIN: Final = 0.04
"""Share of the axis beside the first and the last swept value."""
MOST_LABELS: Final = 12
"""Maximum number of lines named in a legend; of more lines, equally spaced ones are named."""


def median(axes: Axes, lines: SweepLines, legend: bool = True) -> Axes:
    """Draw the median over runs of the metric, with its bootstrap interval."""
    shown = _drawn(axes, lines, "median")
    positive = shown[shown > 0]
    if positive.size and positive.max() > LOG_ERRORS_FROM * positive.min():
        axes.set_yscale("log")
        _written_out(axes.yaxis)
    else:
        highest = float(shown.max(initial=0.0))
        axes.set_ylim(min(0.0, float(shown.min(initial=0.0))), 1.08 * highest if highest > 0.0 else None)
    name = run_metric_name(lines.found.metric)
    axes.set_ylabel(name + bracketed(lines.found.unit))
    return _finished(axes, lines, f"median {name}; {_band(lines)}", legend)


def energy(axes: Axes, lines: SweepLines, legend: bool = True) -> Axes:
    """Draw the median over runs of the energy spent, with its bootstrap interval."""
    shown = _drawn(axes, lines, "energy")
    axes.set_ylim(0.0, 1.08 * float(shown.max(initial=0.0)) or None)  # equal values at the top are not cut
    axes.set_ylabel("energy spent [J]")
    return _finished(axes, lines, f"median energy spent by the network; {_band(lines)}", legend)


def lost(axes: Axes, lines: SweepLines, legend: bool = True) -> Axes:
    """Draw the share of runs in which a track was lost at any time, with Wilson's interval."""
    _drawn(axes, lines, "ever_lost", 100.0)
    axes.set_ylim(-2, 102)
    axes.set_ylabel("runs lost at any time [%]")
    rule = f"; {lines.found.lost}" if lines.found.lost else ""
    return _finished(axes, lines, f"runs lost at any time{rule}; {_band(lines)}", legend)


def differences(axes: Axes, lines: SweepLines, legend: bool = True) -> Axes:
    """Draw the median over runs of the paired differences of the metric, with its interval."""
    axes.axhline(0.0, color=GREY, linewidth=1.0)
    _drawn(axes, lines, "difference")
    name = run_metric_name(lines.found.metric)
    axes.set_ylabel(f"difference of {name}" + bracketed(lines.found.unit))
    return _finished(axes, lines, f"paired differences from {lines.against}; {_band(lines)}", legend)


def lacking(lines: SweepLines) -> dict[str, str]:
    """{name of a plot: why it cannot be drawn}."""
    table = lines.found.table
    reasons = {}
    if not table["median"].notna().any():
        reasons["median"] = f"no run has a {run_metric_name(lines.found.metric)}"
    if not (table["energy"] > 0).any():
        reasons["energy"] = EMPTY["energy_steps"]
    if not table["difference"].notna().any():
        alone = "there is only one point with results"
        lost = "there is no run in which two points both keep their target"
        reasons["differences"] = lines.found.unpaired or (alone if len(table) == 1 else lost)
    return reasons


def _drawn(axes: Axes, lines: SweepLines, name: str, scale: float = 1.0) -> Floats:
    """Draw each line with its band; returns all drawn values as one array."""
    shown: list[Floats] = []
    count, pale = len(lines.lines), 0.15 if len(lines.lines) <= len(DASHES) else 0.08
    named = np.linspace(0, count - 1, min(count, MOST_LABELS)).round() if count > 1 else np.empty(0)
    shades = 1 + max(line.colour for line in lines.lines)
    for number, line in enumerate(lines.lines):
        value, low, high = (scale * lines.column(f"{name}{end}", line) for end in ("", "_low", "_high"))
        places = lines.places[list(line.rows)]
        colour: Any = COLOURS[line.colour % len(COLOURS)]
        if shades > len(COLOURS):  # a shade by the order of the values
            colour = matplotlib.colormaps["viridis"](line.colour / (shades - 1))
        look: dict[str, Any] = {"color": colour, "markersize": 4}
        look["marker"] = MARKS[line.dash % len(MARKS)]
        look["label"] = line.label if number in named else f"_{line.label}"
        if lines.joined:
            axes.fill_between(places, low, high, color=look["color"], alpha=pale, linewidth=0)
            axes.plot(places, value, linestyle=DASHES[line.dash % len(DASHES)], linewidth=1.3, **look)
        else:
            ends = np.nan_to_num(np.array([value - low, high - value]))
            if lines.words and len(lines.lines) > 1:  # lines are offset so that they do not overlap
                places = places + 0.5 * (number / (len(lines.lines) - 1) - 0.5)
            axes.errorbar(places, value, ends, linestyle="", elinewidth=1.1, capsize=2, **look)
        shown += [value, low, high]
    together = np.concatenate(shown)
    return together[np.isfinite(together)]


def _band(lines: SweepLines) -> str:
    return f"{'band' if lines.joined else 'bar'}: 95 % interval, {lines.runs}"


def _finished(axes: Axes, lines: SweepLines, title: str, legend: bool) -> Axes:
    axes.set_title(title, loc="left", wrap=True)
    axes.set_xlabel(lines.key + bracketed(lines.unit))
    _ticked(axes, lines)
    if legend and len(lines.lines) > 1:
        axes.legend(frameon=False)
    return axes


def _ticked(axes: Axes, lines: SweepLines) -> None:
    """Label the swept values on the axis if there is room; the axis is logarithmic if they span decades."""
    values = np.unique(lines.places[np.isfinite(lines.places)])
    if lines.words:
        axes.set_xticks(np.arange(len(lines.words)), lines.words)
        axes.set_xlim(-0.5, len(lines.words) - 0.5)
        return
    is_log = len(values) > 2 and values[0] > 0 and values[-1] >= LOG_FROM * values[0]
    spread = np.log(values) if is_log else values
    if is_log:
        axes.set_xscale("log")
        _written_out(axes.xaxis)
    margin = MARGIN * (spread[-1] - spread[0]) or MARGIN
    ends = np.array([spread[0] - margin, spread[-1] + margin])
    axes.set_xlim(*(np.exp(ends) if is_log else ends))
    if len(values) > 1 and np.diff(spread).min() > CLOSEST * (spread[-1] - spread[0]):
        axes.set_xticks(values, [f"{value:g}" for value in values])
        axes.set_xticks([], minor=True)


def _written_out(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, also between the powers of ten."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_minor_formatter("{x:g}")
