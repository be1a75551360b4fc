"""Figures 3 to 6 of Li (2012): how often the target is tracked, how far off, how late, and who is told in vain.

figure_3(figure, data), ... figure_6(figure, data)       data: a campaign whose variants are named 'tracker, nodes'

The paper's curves are not in its text: only the levels and ranges that it names are drawn.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator

from wsnsim.analysis.figure_style import COLOURS, PUBLISHED
from wsnsim.papers import measures
from wsnsim.papers.li2012 import measures as li2012_measures
from wsnsim.papers.li2012.experiments import DELAY, ERROR, MIDDLE, REPAIRED, TRACKED
from wsnsim.papers.measures import Data

LOOK: Final[dict[str, dict[str, Any]]] = {
    "gmtt": {"color": COLOURS[0]},
    REPAIRED: {"color": COLOURS[5], "linestyle": "-."},
    "tsstp": {"color": COLOURS[1]},
    "tsstp low": {"color": COLOURS[4], "linestyle": (0, (4, 2))},
    "tsstp high": {"color": COLOURS[3], "linestyle": (0, (4, 2))},
    "cluster": {"color": COLOURS[2]},
    "ris": {"color": "#888888", "linestyle": "-."},
}
SAID: Final = {
    "gmtt": "GMTT as printed",
    REPAIRED: "GMTT, repaired",
    "tsstp": "TSSTP, mid",
    "tsstp low": "TSSTP, low",
    "tsstp high": "TSSTP, high",
    "cluster": "Cluster",
    "ris": "nobody woken (RIS)",
}
AT: Final = (1, 5, 10, 15, 20)
BESIDE: Final = {"tsstp": 1.2, "gmtt": 2.0, "cluster": 1.2}
"""Where a published range stands, in steps behind the last."""
SHORT: Final = {"tsstp": "TSSTP", "gmtt": "GMTT", "cluster": "Cluster"}
FIX: Final[dict[str, Any]] = {"color": "#000000", "linewidth": 0.8}
"""How a reference is drawn that is no bound: a filter may know more than the ranges of one step."""
MARK: Final[dict[str, Any]] = {"marker": "o", "markersize": 3.5, "linewidth": 1.2, "capsize": 2.5}


def figure_3(figure: Figure, data: Data) -> None:
    """The share of steps tracked over the number of nodes."""
    columns = {"tracked": "one reading or more", "tracked_three": "three readings or more"}
    for axes, (column, words) in zip(figure.subplots(1, 2, sharey=True), columns.items(), strict=True):
        _over_nodes(axes, data, f"tracks_mean:{column}", tuple(LOOK))
        axes.axhline(TRACKED, label="published at many nodes: near 1", **PUBLISHED)
        axes.set(title=f"in time, from {words}")
    figure.axes[0].set(ylabel="share of steps tracked", ylim=(None, 1.03))
    _legend_below(figure, f"means of {_runs(data)} runs, 95 % intervals")


def figure_4(figure: Figure, data: Data) -> None:
    """The position error at the first 20 steps, at 300 nodes."""
    names = ("cluster", "gmtt", "tsstp")
    possible = pd.Series(li2012_measures.efficient_errors(data, _at(MIDDLE, "gmtt")))
    for axes, name in zip(figure.subplots(1, 3, sharey=True), names, strict=True):
        found = li2012_measures.errors(data, _at(MIDDLE, name))
        _band(axes, found, name)
        _line(axes, found.mean(), f"{SAID[name]}: mean", linestyle="--", linewidth=0.9, color=LOOK[name]["color"])
        if name == "gmtt":
            repaired = li2012_measures.errors(data, _at(MIDDLE, REPAIRED))
            _line(axes, repaired.median(), f"{SAID[REPAIRED]}: median", linewidth=1.2, **LOOK[REPAIRED])
        _line(axes, possible, "an efficient fix of\none step's ranges: median", **FIX)
        axes.axhline(ERROR[name], label=f"published: about {ERROR[name]:g} m", **PUBLISHED)
        axes.set(xlabel="step", xticks=AT, yscale="log", xlim=(0.5, li2012_measures.STEPS + 0.5))
        _ticks(axes, (0.5, 1, 2, 5, 10, 20, 50))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    figure.axes[0].set_ylabel("position error [m]")
    _note(figure, f"{MIDDLE} nodes, {_runs(data)} runs; way-points have no density, so there is no posterior bound")


def figure_5(figure: Figure, data: Data) -> None:
    """The delay of the first 20 estimates, at the main node and at the sink, at 300 nodes."""
    every = round(_of(data, "sink")["every"] / data.scenario(data.variants[0])["step"])
    places = {
        "at the main node": (li2012_measures.delays, "step"),
        "at the sink": (li2012_measures.report_delays, "step" if every == 1 else "report"),
    }
    for axes, (place, (measure, counted)) in zip(figure.subplots(1, 2, sharey=True), places.items(), strict=True):
        for name, ends in DELAY.items():
            _band(axes, 1e3 * measure(data, _at(MIDDLE, name)), name)
            _published(axes, li2012_measures.STEPS + BESIDE[name], ends, name)
        axes.set(title=place, xlabel=counted, xticks=AT, yscale="log", ylim=(8, 400), xlim=(0.5, None))
        _ticks(axes, (10, 20, 40, 60, 90, 200, 300))
    figure.axes[0].set_ylabel("delay [ms]")
    _legend_below(figure, f"{MIDDLE} nodes, {_runs(data)} runs")


def figure_6(figure: Figure, data: Data) -> None:
    """Nodes that were told in vain in 20 steps, and in 20 reports where these are more, over the number of nodes."""
    shown = {"ineffective_twenty": "in 20 steps"}
    scenario = data.scenario(data.variants[0])
    if scenario["duration"] == li2012_measures.STEPS * scenario["sink"]["every"] != 20 * scenario["step"]:
        shown["ineffective"] = "in 20 reports"
    for axes, (column, words) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        _over_nodes(axes, data, f"tracks_mean:{column}", tuple(name for name in LOOK if name != "ris"))
        axes.set(title=words, ylim=(0, None))
    figure.axes[0].set_ylabel("nodes told in vain")
    _legend_below(figure, f"means of {_runs(data)} runs, 95 % intervals; published: TSSTP far above both, all growing")


def _over_nodes(axes: Axes, data: Data, measure: str, trackers: tuple[str, ...]) -> None:
    """A line a tracker, of those that were run."""
    for name in trackers:
        densities = sorted(nodes for tracker, nodes in map(_parted, data.variants) if tracker == name)
        found = [measures.measured(data, _at(nodes, name), measure) for nodes in densities]
        if found:
            values, low, high = (np.array([getattr(one, key) for one in found]) for key in ("value", "low", "high"))
            shifted = np.array(densities) + 3.0 * (tuple(LOOK).index(name) - 3)
            axes.errorbar(shifted, values, [values - low, high - values], label=SAID[name], **MARK, **LOOK[name])
    axes.set(
        xlabel="nodes (markers set side by side)", xticks=sorted({nodes for _, nodes in map(_parted, data.variants)})
    )


def _band(axes: Axes, rows: pd.DataFrame, name: str) -> None:
    """The median over runs and the quartiles, at the steps where any run has a value."""
    known = rows.notna().any().to_numpy()
    low, middle, high = np.nanquantile(rows.to_numpy()[:, known], [0.25, 0.5, 0.75], axis=0)
    x = 1 + np.flatnonzero(known)
    axes.plot(x, middle, linewidth=1.4, color=LOOK[name]["color"],
              label=f"{SAID[name]}: median and quartiles")  # fmt: skip
    axes.fill_between(x, low, high, color=LOOK[name]["color"], alpha=0.18, linewidth=0)


def _published(axes: Axes, x: float, ends: tuple[float, float], name: str) -> None:
    """A published range of delays, as a bar beside the curves."""
    low, high = (1e3 * end for end in ends)
    middle = (low + high) / 2.0
    axes.errorbar([x], [middle], [[middle - low], [high - middle]], color=LOOK[name]["color"], linestyle="none",
                  linewidth=2.5, capsize=4, label=f"{SHORT[name]}: published {low:g} to {high:g} ms")  # fmt: skip


def _line(axes: Axes, values: pd.Series, label: str, **look: Any) -> None:
    axes.plot(1 + np.arange(len(values)), values, label=label, **look)


def _ticks(axes: Axes, places: tuple[float, ...]) -> None:
    """Plain numbers on a logarithmic axis."""
    axes.yaxis.set_major_locator(FixedLocator(list(places)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))


def _legend_below(figure: Figure, title: str) -> None:
    """One legend for all panels."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, title=title)


def _note(figure: Figure, words: str) -> None:
    figure.supxlabel(words, fontsize="medium")


def _at(nodes: int, tracker: str) -> str:
    return f"{tracker}, {nodes}"


def _parted(variant: str) -> tuple[str, int]:
    """(the tracker, the number of nodes) of a variant."""
    tracker, _, nodes = variant.rpartition(", ")
    return tracker, int(nodes)


def _of(data: Data, role: str) -> Any:
    return data.scenario(data.variants[0])[role]


def _runs(data: Data) -> int:
    """Runs of each variant."""
    return len(data.lost(data.variants[0]))
