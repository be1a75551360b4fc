"""Figures 1 to 4 of Liu, Wang (2012), ours.

figure_N(figure, data) puts axes on a figure and draws
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import BOUND, COLOURS, band, rmse_band, with_bands
from wsnsim.base.arrays import Floats
from wsnsim.papers.liu2012.measures import TAKES_PART, probabilities
from wsnsim.papers.measures import Data

NAMES: Final = {"rkf": "RKF", "imsf": "IMSF"}
BESIDE: Final = {
    "rkf, spread": "RKF with the spread of means",
    "imsf, mixing as printed": "IMSF, (23) as printed",
    "ekf, sensors in range": "EKF, sensors in range",
    "ekf, nearest sensor": "EKF, nearest sensor",
}
COLOUR: Final = dict(zip((*NAMES, *BESIDE), COLOURS, strict=False))
IN_RANGE: Final = "#EDEDED"


def figure_1(figure: Figure, data: Data) -> None:
    """Position errors at each step."""
    bound = data.bound("rkf", "unconditional").rmse
    _errors(figure, data, data.errors, bound, "position error [m]")


def figure_2(figure: Figure, data: Data) -> None:
    """Velocity errors at each step."""
    bound = data.bound("rkf", "unconditional").columns[:, 1]
    _errors(figure, data, lambda variant: np.abs(data.column_errors(variant, "vx")), bound, "velocity error [m/s]")


def figure_3(figure: Figure, data: Data) -> None:
    """The sensors' probabilities in one run of RKF."""
    _relay(figure, data, "rkf")


def figure_4(figure: Figure, data: Data) -> None:
    """The sensors' probabilities in the same run of IMSF."""
    _relay(figure, data, "imsf")


def _errors(figure: Figure, data: Data, errors: Callable[[str], Floats], bound: Floats, what: str) -> None:
    """RMSE over runs of all variants, with the bound; and what a run is like with the two of the paper."""
    left, right = figure.subplots(1, 2, sharex=True)
    steps = np.arange(1.0, len(bound) + 1.0)
    for variant, name in (NAMES | BESIDE).items():
        rows, lost = errors(variant), int(data.lost(variant).sum())
        label = name + (f" ({lost} of {len(rows)} lost)" if lost else "")
        rmse_band(left, steps, rows, label, COLOUR[variant], width=1.5 if variant in NAMES else 0.9)
    for variant, name in NAMES.items():
        band(right, steps, errors(variant), name, COLOUR[variant])
    left.plot(steps, bound, label="bound (posterior Cramér-Rao)", **BOUND)
    for axes in (left, right):
        axes.set(xlabel="time [s]", xlim=(0, steps[-1]))
    left.set(yscale="log", ylabel=f"RMSE: {what}")
    left.set_title(f"RMSE over {with_bands(len(rows))}, lost ones included", loc="left")
    right.set(ylabel=what, ylim=(0, None))
    right.set_title("a run: absolute error", loc="left")
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1 if axes is right else 2, frameon=False)


def _relay(figure: Figure, data: Data, variant: str) -> None:
    """A row a sensor: its probability, when the target is within its radius, and where the target is among them."""
    axes = figure.subplots()
    replicate, track, times = _farthest(data, variant)
    chances = probabilities(data, variant)[replicate]
    nodes = data.of(variant, "nodes")
    nodes = nodes[nodes["replicate"] == replicate].sort_values("node")
    places, reach = nodes[["x", "y"]].to_numpy(), float(data.scenario(variant)["sensor"]["reach"])
    for row, (x, y) in enumerate(places):
        within = np.hypot(track - x, y) <= reach
        axes.fill_between(times, row, row + 0.9, where=within, color=IN_RANGE, linewidth=0)
        axes.fill_between(times, row, row + 0.9 * chances[:, row], color=COLOUR[variant], linewidth=0)
    beside = np.interp(track, places[:, 0], np.arange(len(places)) + 0.45)
    axes.plot(times, beside, color="#000000", linewidth=1.2, label="the target's place among the sensors")
    axes.set_yticks(np.arange(len(places)) + 0.45, [f"{row + 1}: {x:g} m" for row, (x, _) in enumerate(places)])
    part = (chances >= TAKES_PART).sum(axis=0).mean()
    axes.set_title(
        f"{NAMES[variant]}, replicate {replicate}; a sensor has {TAKES_PART:g} or more at {part:.0f} steps on average",
        loc="left",
    )
    axes.fill_between([], [], [], color=COLOUR[variant], label="probability, from 0 to 1 in each row")
    axes.fill_between([], [], [], color=IN_RANGE, label="target within the sensor's radius")
    _framed(axes, len(places), times)


def _framed(axes: Axes, rows: int, times: Floats) -> None:
    axes.set(xlabel="time [s]", ylabel="sensor, at x", xlim=(0, times[-1]), ylim=(0, rows))
    axes.grid(visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False)


def _farthest(data: Data, variant: str) -> tuple[int, Floats, Floats]:
    """The run whose target comes farthest without passing the last sensor [our choice]: replicate, places, times."""
    truth, last = data.of(variant, "truth"), data.of(variant, "nodes")["x"].max()
    ends = truth[truth["step"] == truth["step"].max()].set_index("replicate")["px"]
    inside = ends[ends <= last]
    replicate = int((inside if len(inside) else ends).idxmax())
    run = truth[(truth["replicate"] == replicate) & (truth["step"] > 0)].sort_values("step")
    return replicate, run["px"].to_numpy(), run["time"].to_numpy()
