"""Pictures of an estimated lifetime: shares over the days, joules by cause, and the field by day of death.

Each function takes Axes and the outcome of a scenario (see `lifetime_result`), and returns the Axes.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes

from wsnsim.analysis.figure_style import BLUE, GREEN, GREY, ORANGE, SKY, STYLE, VERMILLION, figure_of, save
from wsnsim.analysis.lifetime_text import DAY, Point

CURVES: Final = {
    "alive": (BLUE, "nodes alive"),
    "coverage": (GREEN, "coverage"),
    "tracked": (VERMILLION, "tracked steps"),
}
MOST_CAUSES: Final = 8


def shares(axes: Axes, point: Point) -> Axes:
    """Shares of nodes alive, of the area covered and of steps tracked over the days, with 95 % bands of networks."""
    curves = point["curves"]
    days = np.asarray(curves["time"]) / DAY
    for name, (colour, label) in CURVES.items():
        axes.plot(days, curves[name], color=colour, linewidth=1.3, label=label)
        axes.fill_between(days, curves[f"{name}_low"], curves[f"{name}_high"], color=colour, alpha=0.18, linewidth=0)
    first = point["criteria"][0]["median"] / DAY
    if np.isfinite(first):
        axes.axvline(first, color=GREY, linewidth=0.9, linestyle=":", label="first death (median)")
    axes.set(xlabel="time [days]", ylabel="share", ylim=(0.0, 1.03), title="Life (median, 95 % of networks)")
    axes.legend(loc="lower left", frameon=False)
    return axes


def causes(axes: Axes, point: Point) -> Axes:
    """The mean node's joules per day by cause: without a target, and in visits."""
    found = point["causes"]
    names = [cause.replace("_", " ") for cause in found["cause"][:MOST_CAUSES]][::-1]
    quiet, visits = (DAY * np.asarray(found[key][:MOST_CAUSES])[::-1] for key in ("quiet", "visits"))
    axes.barh(names, quiet, color=SKY, label="without a target")
    axes.barh(names, visits, left=np.maximum(quiet, 0.0), color=ORANGE, label="visits")
    axes.set(xlabel="energy [J per day]", title="Energy of the mean node by cause")
    axes.legend(loc="lower right", frameon=False)
    axes.grid(axis="y", visible=False)
    return axes


def field(axes: Axes, point: Point) -> Axes:
    """The nodes in the field, coloured by the day on which they die (median); sinks are squares."""
    nodes = point["nodes"]
    x, y, days = np.asarray(nodes["x"]), np.asarray(nodes["y"]), np.asarray(nodes["died"]) / DAY
    known, sinks = np.isfinite(days), np.asarray(nodes["sink"], dtype=bool)
    axes.scatter(x[~known], y[~known], s=26, facecolors="none", edgecolors=GREY, label="alive at the end")
    if known.any():
        dots = axes.scatter(x[known], y[known], s=34, c=days[known], cmap="viridis")
        axes.figure.colorbar(dots, ax=axes, label="day of death (median)", shrink=0.85)
    if sinks.any():
        axes.scatter(x[sinks], y[sinks], s=90, marker="s", facecolors="none", edgecolors=VERMILLION, label="sink")
    axes.set(xlabel="x [m]", ylabel="y [m]", title="Who dies when")
    axes.set_aspect("equal")
    if sinks.any() or not known.all():
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.16), ncols=2, frameon=False)
    return axes


PANELS: Final = {"shares": shares, "causes": causes, "field": field}


def write(point: Point, out: Path) -> Path:
    """Write a figure of all panels; its suffix is .png, .svg or .pdf. Raises UsageError, ResultError."""
    with style.context(["default", STYLE]):
        save(figure_of([partial(panel, point=point) for panel in PANELS.values()]), out)
    return out
