"""Error against joules, and what a wake interval changes: a line for each tracker, a point for each interval."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from wsnsim.analysis.figure_style import COLOURS
from wsnsim.base.arrays import Floats
from wsnsim.papers.answers import Interval
from wsnsim.papers.duty_cycles.best import ENERGY, ERROR, IN_TIME, best
from wsnsim.papers.duty_cycles.hypotheses import WITH_THREE
from wsnsim.papers.duty_cycles.points import REFERENCE, intervals, kinds, run, trackers, value
from wsnsim.papers.measures import Data
from wsnsim.papers.plotting import Drawings, legend_below, plain_numbers

NAMES: Final = {"xmac": "X-MAC", "contikimac": "ContikiMAC", "tsch": "TSCH", "tsch, shared 4": "TSCH, 4 shared cells"}
ROWS: Final = {
    ENERGY: "energy [J]",
    ERROR: "error [m]",
    IN_TIME: "share in time",
    WITH_THREE: "the same, with three",
    "tracks_median:delay": "latency at the head [s]",
}
"""The rows of the figure by interval, and their axes."""
SHARES: Final = (IN_TIME, WITH_THREE)
HEADROOM: Final = 3.0
"""How far the axis of errors goes beyond the greatest; intervals with runs that lost the target can be far longer."""


def against_joules(figure: Figure, data: Data) -> None:
    """The median error against the network's energy, a panel for each kind of MAC, that of CSMA last and narrow."""
    found = [*kinds(data), REFERENCE]
    widths = (*(1.0 for _ in kinds(data)), 0.4)
    panels = figure.subplots(1, len(found), sharey=True, squeeze=False, width_ratios=widths)[0]
    for axes in panels[1:-1]:
        axes.sharex(panels[0])
    for axes, kind in zip(panels, found, strict=True):
        axes.set(xscale="log", yscale="log", xlabel="energy of the network [J]", title=NAMES.get(kind, "CSMA"))
        for tracker, colour in zip(trackers(data), COLOURS, strict=False):
            _line(axes, data, tracker, kind, colour)
        _plain(axes)
    panels[-1].set(xscale="linear", xlabel="energy [J]")
    low, high = panels[-1].get_xlim()
    panels[-1].set_xlim(min(low, 0.95 * high), max(high, low / 0.95))  # equal energies shall look equal
    panels[-1].xaxis.set_major_locator(MaxNLocator(2))
    panels[0].set_ylabel("position error, median of a run [m]")
    errors = np.array([value(data, variant, ERROR).value for variant in run(data)])
    if np.isfinite(errors).any():
        panels[0].set_ylim(top=min(panels[0].get_ylim()[1], HEADROOM * np.nanmax(errors)))
    legend_below(figure, panels, columns=len(trackers(data)))


def _line(axes: Axes, data: Data, tracker: str, kind: str, colour: str) -> None:
    """A tracker's points on a kind of MAC; the best interval has a ring, the greatest and the least are named."""
    reference = f"{tracker}, {REFERENCE}"
    known = {0.0: reference} if kind == REFERENCE else intervals(data, tracker, kind)
    found = {seconds: variant for seconds, variant in known.items() if variant in run(data)}
    look: dict[str, Any] = {"color": colour, "capsize": 2.0, "elinewidth": 0.7, "linewidth": 1.2, "label": tracker}
    _marked(axes, data, [*found.values()], {**look, "marker": "o", "markersize": 3.5})
    if kind == REFERENCE or not found:
        return
    for seconds in {min(found), max(found)}:
        axes.annotate(_said(seconds), _place(data, found[seconds]), (3, 4), textcoords="offset points", fontsize=6.5,
                      color=colour)  # fmt: skip
    chosen = best(data, tracker, kind).interval.value if reference in run(data) else np.nan
    if chosen in found:
        axes.plot(*_place(data, found[chosen]), "o", markersize=10, markerfacecolor="none", color=colour)


def _place(data: Data, variant: str) -> tuple[float, float]:
    """Energy and error of a point."""
    return value(data, variant, ENERGY).value, value(data, variant, ERROR).value


def _marked(axes: Axes, data: Data, variants: list[str], look: dict[str, Any]) -> None:
    """Points of error and energy with their 95 % intervals."""
    x, y = ([value(data, variant, measure) for variant in variants] for measure in (ENERGY, ERROR))
    bars = (_bars(y), _bars(x)) if variants else (None, None)
    axes.errorbar([each.value for each in x], [each.value for each in y], *bars, **look)


def _bars(found: list[Interval]) -> Floats:
    """(2, n) the lengths of the error bars; none where the interval is not finite."""
    bars = np.array([[each.value - each.low for each in found], [each.high - each.value for each in found]])
    return np.where(np.isfinite(bars), np.maximum(bars, 0.0), 0.0)


def by_interval(figure: Figure, data: Data) -> None:
    """Energy, error, shares in time and latency over the wake interval, a column for each kind of MAC."""
    found = kinds(data) or [REFERENCE]
    grid = figure.subplots(len(ROWS), len(found), sharex="col", sharey="row", squeeze=False)
    for column, kind in enumerate(found):
        for axes, (measure, words) in zip(grid[:, column], ROWS.items(), strict=True):
            axes.set(xscale="log", yscale="linear" if measure in SHARES else "log")  # before points that may be unknown
            for tracker, colour in zip(trackers(data), COLOURS, strict=False):
                _over_intervals(axes, data, (tracker, kind, measure), colour)
            if measure not in SHARES:
                plain_numbers(axes)
            if column == 0:
                axes.set_ylabel(words)
        grid[0, column].set_title(NAMES.get(kind, "CSMA"))
        grid[-1, column].set_xlabel("slotframe" if kind.startswith("tsch") else "wake interval")
        ticks = sorted(
            {one for tracker in trackers(data) for one in intervals(data, tracker, kind)} if kind in NAMES else ()
        )
        grid[-1, column].xaxis.set_major_locator(FixedLocator(ticks))
        grid[-1, column].xaxis.set_minor_locator(NullLocator())
        grid[-1, column].xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _said(seconds)))
    legend_below(figure, grid.ravel(), columns=len(trackers(data)) + 1)


def _over_intervals(axes: Axes, data: Data, what: tuple[str, str, str], colour: str) -> None:
    """A measure of a tracker over the intervals of a kind of MAC; CSMA as a dotted line."""
    tracker, kind, measure = what
    found = intervals(data, tracker, kind) if kind in NAMES else {}
    values = [value(data, variant, measure) for variant in found.values()]
    axes.errorbar([*found], [each.value for each in values], _bars(values) if values else None, color=colour,
                  marker="o", markersize=3.0, linewidth=1.0, capsize=2.0, elinewidth=0.7, label=tracker)  # fmt: skip
    if f"{tracker}, {REFERENCE}" in run(data):
        level = value(data, f"{tracker}, {REFERENCE}", measure).value
        axes.axhline(level, color=colour, linestyle=":", linewidth=0.9)


def _said(seconds: float) -> str:
    """An interval in words: 62.5 ms, 1 s."""
    return f"{1e3 * seconds:g} ms" if seconds < 1.0 else f"{seconds:g} s"


def _plain(axes: Axes) -> None:
    """Label both logarithmic axes with plain numbers."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda number, _: f"{number:g}"))


FIGURES: Final[Drawings] = {"against_joules": against_joules, "by_interval": by_interval}
