"""Figures 1, 2, 4 and 5 of Ruan, Wang, Yang, Zhang (2020), ours; 4 and 5 of a simulated room in place of the real one.

figure_N(figure, data) puts axes on a figure and draws; where one run is shown, it is replicate 0
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from wsnsim.analysis.figure_style import BOUND, COLOURS, PUBLISHED, rmse_band, with_bands
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data
from wsnsim.papers.ruan2020 import TABLE_1

NAMES: Final = {"pf": "PF", "gpf": "GPF", "pso_gpf": "PSO-GPF", "gsa_gpf": "GSA-GPF"}
LITERAL: Final = {f"{kind}, 100": name for kind, name in NAMES.items()}
BESIDE: Final = {"gsa_gpf, 100, greedy": "GSA-GPF, greedy", "pf, 5000": "PF, 5000 particles", "ekf": "EKF"}
COLOUR: Final = dict(zip((*LITERAL, *BESIDE), (*COLOURS[:4], *COLOURS[4:6], "#8C8C8C"), strict=True))
KIND: Final = "per_trajectory"
MARGIN: Final = 0.7
"""m around what is shown."""


def figure_1(figure: Figure, data: Data) -> None:
    """One run from above: the filters as printed, and what stands beside them."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _tracks(left, data, LITERAL)
    left.set_title("as printed, N = 100", loc="left")
    _tracks(right, data, BESIDE)
    right.set_title("repaired, and references", loc="left")
    left.set_ylabel("y [m]")
    (x_low, y_low), (x_high, y_high) = _shown(data)
    left.set(xlim=(x_low, x_high), ylim=(y_low, y_high))
    _legend(figure, (left, right))


def figure_2(figure: Figure, data: Data) -> None:
    """Errors at each step: of one run, and the root mean square of all."""
    _errors(figure, data, printed=True)


def figure_4(figure: Figure, data: Data) -> None:
    """As figure 1, in the smaller room."""
    figure_1(figure, data)


def figure_5(figure: Figure, data: Data) -> None:
    """As figure 2, in the smaller room; of this the paper prints no number."""
    _errors(figure, data, printed=False)


def _tracks(axes: Axes, data: Data, variants: dict[str, str]) -> None:
    """The room, its anchors, the truth, and the estimates of replicate 0."""
    truth = _first(data, "pf, 100", "truth")
    deploy: Any = data.scenario("pf, 100")["deploy"]
    anchors, wide, high = np.array(deploy["places"]), deploy["width"], deploy["height"]
    axes.plot([0, wide, wide, 0, 0], [0, 0, high, high, 0], color="#8C8C8C", linewidth=1.0, label="room")
    axes.plot(*anchors.T, "^", color="#000000", markersize=7, linestyle="", label="anchors")
    axes.plot(truth["px"], truth["py"], color="#000000", linewidth=2.0, label="truth")
    axes.plot(truth["px"].iloc[0], truth["py"].iloc[0], "o", color="#000000", markersize=5, label="start")
    for variant, name in variants.items():
        run = _first(data, variant, "estimates")
        label = f"{name} (RMSE of this run {metrics.rmse(run['error'].to_numpy()):.2f} m)"
        axes.plot(run["px"], run["py"], ".-", color=COLOUR[variant], linewidth=1.0, markersize=4, label=label)
    axes.set(aspect="equal", xlabel="x [m]")


def _shown(data: Data) -> tuple[Floats, Floats]:
    """The lower left and the upper right corner of what holds the truth and all estimates of replicate 0."""
    tables = [_first(data, "pf, 100", "truth"), *(_first(data, name, "estimates") for name in LITERAL | BESIDE)]
    places = np.concatenate([table[["px", "py"]].to_numpy(dtype=np.float64) for table in tables])
    return places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN


def _errors(figure: Figure, data: Data, printed: bool) -> None:
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    for variant, name in (LITERAL | BESIDE).items():
        rows = data.errors(variant)
        times = _first(data, variant, "estimates")["time"].to_numpy()
        width = 1.4 if variant in LITERAL else 1.0
        left.plot(times, rows[0], color=COLOUR[variant], linewidth=width)
        mean, lost = metrics.time_mean_rmse(rows), int(data.lost(variant).sum())
        label = f"{name}: mean {mean:.2f} m" + (f", {lost} of {len(rows)} lost" if lost else "")
        rmse_band(right, times, rows, label, COLOUR[variant], width)
        if printed and variant in LITERAL:
            level = TABLE_1[variant.split(",")[0]][100]
            label = f"{name}, published mean: {level:.2f} m"
            right.axhline(level, label=label, **{**PUBLISHED, "color": COLOUR[variant]})
    bound = data.bound("pf, 100", KIND)
    right.plot(times, bound.rmse, label=f"bound along each truth: mean {bound.time_mean:.2f} m", **BOUND)
    left.set(yscale="log", xlabel="time [s]", ylabel="position error [m]", xlim=(0, None))
    _ticks(left)
    left.set_title("replicate 0", loc="left")
    right.set_title(f"RMSE over {with_bands(len(rows))}", loc="left")
    right.set_xlabel("time [s]")
    _legend(figure, (right,))


def _ticks(axes: Axes) -> None:
    """Plain numbers on a logarithmic axis, three a decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))


def _legend(figure: Figure, panels: Iterable[Axes]) -> None:
    """One legend for all panels, each entry once."""
    entries = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=3, frameon=False)


def _first(data: Data, variant: str, table: str) -> Any:
    """Replicate 0 of a table."""
    frame = data.of(variant, table)
    return frame[frame["replicate"] == 0].sort_values("step")
