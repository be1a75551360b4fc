"""Figures 1 to 4 of Liu, Wang (2012)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import COLOURS, band, runs_text
from wsnsim.base.arrays import Floats
from wsnsim.papers.liu2012.measures import TAKES_PART, probabilities
from wsnsim.papers.measures import Data
from wsnsim.papers.plotting import BLACK, Drawings, Look, bound_curve, lost_runs, rmse_curves, times

PRINTED: Final = {"rkf": Look("RKF", COLOURS[0], 1.5), "imsf": Look("IMSF", COLOURS[1], 1.5)}
OTHERS: Final = {
    "rkf, spread": Look("RKF with the spread of means", COLOURS[2], 0.9),
    "imsf, mixing as printed": Look("IMSF, (23) as printed", COLOURS[3], 0.9),
    "ekf, sensors in range": Look("EKF, sensors in range", COLOURS[4], 0.9),
    "ekf, nearest sensor": Look("EKF, nearest sensor", COLOURS[5], 0.9),
}
IN_RANGE: Final = "#EDEDED"


def _position(figure: Figure, data: Data) -> None:
    """Position errors at each step."""
    _errors(figure, data, data.errors, data.bound("rkf", "unconditional").rmse, "position error [m]")


def _velocity(figure: Figure, data: Data) -> None:
    """Velocity errors at each step."""
    bound = data.bound("rkf", "unconditional").columns[:, 1]
    _errors(figure, data, lambda variant: np.abs(data.column_errors(variant, "vx")), bound, "velocity error [m/s]")


def _errors(figure: Figure, data: Data, errors: Callable[[str], Floats], bound: Floats, what: str) -> None:
    """RMSE over runs of all variants with the bound; and the absolute errors of single runs of the paper's two."""
    left, right = figure.subplots(1, 2, sharex=True)
    runs = rmse_curves(left, data, PRINTED | OTHERS, lost_runs(data), errors)
    for variant, look in PRINTED.items():
        band(right, times(data, variant, len(bound)), errors(variant), look.name, look.colour)
    bound_curve(left, bound, data.scenario("rkf")["step"], "bound (posterior Cramér-Rao)")
    left.set(ylabel=f"RMSE: {what}", xlim=(0, times(data, "rkf", len(bound))[-1]))
    left.set_title(f"RMSE over {runs_text(runs)}, lost ones included", loc="left")
    right.set(xlabel="time [s]", ylabel=what, ylim=(0, None))
    right.set_title("absolute error of a run", loc="left")
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1 if axes is right else 2, frameon=False)


def _relay(figure: Figure, data: Data, variant: str) -> None:
    """One row for each sensor: its probability, when the target is within its range, and the target's position."""
    axes, look = figure.subplots(), PRINTED[variant]
    replicate, track, time = _farthest(data, variant)
    chances = probabilities(data, variant)[replicate]
    nodes = data.of(variant, "nodes")
    places = nodes[nodes["replicate"] == replicate].sort_values("node")[["x", "y"]].to_numpy()
    sensing_range = float(data.scenario(variant)["sensor"]["reach"])
    for row, (x, y) in enumerate(places):
        within = np.hypot(track - x, y) <= sensing_range
        axes.fill_between(time, row, row + 0.9, where=within, color=IN_RANGE, linewidth=0)
        axes.fill_between(time, row, row + 0.9 * chances[:, row], color=look.colour, linewidth=0)
    beside = np.interp(track, places[:, 0], np.arange(len(places)) + 0.45)
    axes.plot(time, beside, color=BLACK, linewidth=1.2, label="the target's position among the sensors")
    axes.set_yticks(np.arange(len(places)) + 0.45, [f"{row + 1}: {x:g} m" for row, (x, _) in enumerate(places)])
    part = (chances >= TAKES_PART).sum(axis=0).mean()
    axes.set_title(
        f"{look.name}, replicate {replicate}; a sensor has {TAKES_PART:g} or more at {part:.0f} steps on average",
        loc="left",
    )
    axes.fill_between([], [], [], color=look.colour, label="probability, from 0 to 1 in each row")
    axes.fill_between([], [], [], color=IN_RANGE, label="target within the sensing range")
    _frame(axes, len(places), time)


def _frame(axes: Axes, rows: int, time: Floats) -> None:
    axes.set(xlabel="time [s]", ylabel="sensor, at x", xlim=(0, time[-1]), ylim=(0, rows))
    axes.grid(visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False)


def _farthest(data: Data, variant: str) -> tuple[int, Floats, Floats]:
    """The run whose target comes farthest without passing the last sensor [our choice]: replicate, positions, times."""
    truth, last = data.of(variant, "truth"), data.of(variant, "nodes")["x"].max()
    ends = truth[truth["step"] == truth["step"].max()].set_index("replicate")["px"]
    inside = ends[ends <= last]
    replicate = int((inside if len(inside) else ends).idxmax())
    run = truth[(truth["replicate"] == replicate) & (truth["step"] > 0)].sort_values("step")
    return replicate, run["px"].to_numpy(), run["time"].to_numpy()


FIGURES: Final[Drawings] = {
    "figure_1": _position,
    "figure_2": _velocity,
    "figure_3": partial(_relay, variant="rkf"),
    "figure_4": partial(_relay, variant="imsf"),
}
