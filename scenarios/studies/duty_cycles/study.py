"""Measures of trackers on duty-cycled radios: reports delivered, time with the radio on, lifetimes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from wsnsim.papers.toolkit import COLOURS, Data, Floats, Interval, OwnMeasure, plotting

from . import hypotheses
from .hypotheses import WITH_THREE
from .points import ENERGY, ERROR, IN_TIME, REFERENCE, Best, best, intervals, kinds, over_known, run, trackers, value

DAY: Final = 86_400.0
"""Seconds of a day."""


def error(data: Data, variant: str) -> pd.Series:
    """The median position error (m) of each run, by replicate."""
    return data.of_runs(variant, "median_error")


def delivered(data: Data, variant: str) -> pd.Series:
    """The share of the due reports that reached the sink, by replicate."""
    tracks = data.of(variant, "tracks").groupby("replicate")[["received", "due"]].sum()
    return tracks["received"] / tracks["due"]


def radio_on(data: Data, variant: str) -> pd.Series:
    """The share of time with the radio on, mean over nodes, by replicate; nodes that are awake listen without a break.

    The column `radio_on` of `runs` where the MAC is duty-cycled, elsewhere `awake`.
    """
    runs = data.of(variant, "runs").set_index("replicate")
    awake = runs["awake"].astype(np.float64)
    return runs["radio_on"].astype(np.float64).fillna(awake) if "radio_on" in runs else awake


def days(data: Data, variant: str, busiest: bool) -> pd.Series:
    """The days that two AA cells last at the mean power of a run, of the mean node or of the busiest, by replicate.

    The sink does not count among the busiest: it is the node nearest to the point of the scenario's sink.
    """
    scenario = data.scenario(variant)
    found = {}
    for replicate, nodes in data.of(variant, "nodes").groupby("replicate"):
        spent = (nodes["energy_initial"] - nodes["energy_left"]).to_numpy(dtype=np.float64)
        if busiest:
            away = np.hypot(nodes["x"] - scenario["sink"]["x"], nodes["y"] - scenario["sink"]["y"]).to_numpy()
            spent = np.delete(spent, np.argmin(away))
        joules = float(spent.max() if busiest else spent.mean())
        found[replicate] = scenario["energy"]["battery"] / joules * scenario["duration"] / DAY
    return pd.Series(found)


MEASURES: Final[dict[str, OwnMeasure]] = {
    "error": error,
    "delivered": delivered,
    "radio_on": radio_on,
    "days": partial(days, busiest=False),
    "days_busiest": partial(days, busiest=True),
}


def conclusions(data: Data) -> list[str]:
    """The best interval of each tracker on each kind of MAC, and the answers to the hypotheses."""
    return [*best_lines(data), *hypotheses.lines(data)]


def best_lines(data: Data) -> list[str]:
    """A line for each tracker and kind of MAC: the best interval, the energy there, and of how many it is."""
    return [
        _best_line(best(data, tracker, kind), kind, len(intervals(data, tracker, kind)))
        for tracker, kind in _choices(data)
    ]


def best_points(data: Data) -> list[dict[str, str]]:
    """{tracker, mac, csma, point} of each tracker and kind of MAC: its variant on CSMA, and that at the best interval.

    The point is '' where no interval is usable.
    """
    return [
        {
            "tracker": tracker, "mac": kind, "csma": f"{tracker}, {REFERENCE}",
            "point": intervals(data, tracker, kind).get(best(data, tracker, kind).interval.value, ""),
        }
        for tracker, kind in _choices(data)
    ]  # fmt: skip


def _choices(data: Data) -> Iterator[tuple[str, str]]:
    """Trackers and kinds of MACs that have points, of trackers that ran on CSMA."""
    for kind in kinds(data):
        for tracker in trackers(data):
            if intervals(data, tracker, kind) and f"{tracker}, {REFERENCE}" in run(data):
                yield tracker, kind


def _best_line(one: Best, kind: str, count: int) -> str:
    """'gmtt on xmac: best interval 0.25 s [0.25, 0.5], 13.70 [13.11, 14.17] J, best of 5 points'."""
    words = f"{one.tracker} on {kind}: best interval"
    if not one.usable:
        return f"{words} none, " + (
            f"none of {count} points is usable" if count > 1 else "the only point is not usable"
        )
    seconds, joules = one.interval, over_known(one.energies)
    without = f" ({one.without:.0%} of the resamples have none)" if one.without else ""
    among = f"best of {count} points" if count > 1 else "the only point: no choice"
    return f"{words} {seconds.value:g} s [{seconds.low:g}, {seconds.high:g}], {joules} J{without}, {among}"


SUMMARIES: Final = {"answers": conclusions}


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
    plotting.legend_below(figure, panels, columns=len(trackers(data)))


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
                plotting.plain_numbers(axes)
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
    plotting.legend_below(figure, grid.ravel(), columns=len(trackers(data)) + 1)


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


FIGURES: Final[plotting.Drawings] = {"against_joules": against_joules, "by_interval": by_interval}
