"""Measures of Ruan, Wang, Yang, Zhang (2020): growth of errors, what particles save, truths outside; its figures.

Figures 1 and 2; 4 and 5 of a simulated room in place of the real one.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import COLOURS, Data, Floats, plotting, runs_text

SLACK: Final = 0.5
"""How far outside the room a target may be (m) [our choice]."""


def growth(data: Data, variant: str) -> pd.Series:
    """The root mean square error of the last third of a run, less that of the first third (m)."""
    errors = data.errors(variant)
    third = errors.shape[1] // 3
    first, last = (np.sqrt((part**2).mean(axis=1)) for part in (errors[:, :third], errors[:, -third:]))
    return pd.Series(last - first, index=np.sort(data.of(variant, "runs")["replicate"].to_numpy()))


def saved(data: Data, variant: str) -> pd.Series:
    """The fraction by which the RMSE of a run with 200 particles is below that with 50."""
    kind = variant.partition(", ")[0]
    return 1.0 - data.of_runs(f"{kind}, 200", "rmse") / data.of_runs(f"{kind}, 50", "rmse")


def outside(data: Data, variant: str) -> pd.Series:
    """1 for each run whose ground truth leaves the room by more than 0.5 m, the slack of `in_room`, otherwise 0."""
    deploy: Any = data.scenario(variant)["deploy"]
    low, high = -SLACK, np.array([deploy["width"], deploy["height"]]) + SLACK
    truth = data.of(variant, "truth")
    places = truth[["px", "py"]]
    return ((places < low) | (places > high)).any(axis=1).groupby(truth["replicate"]).any().astype(float)


_FUNCTIONS: Final = (growth, saved, outside)
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}


PRINTED: Final = {
    "pf, 100": plotting.Look("PF", COLOURS[0], 1.4),
    "gpf, 100": plotting.Look("GPF", COLOURS[1], 1.4),
    "pso_gpf, 100": plotting.Look("PSO-GPF", COLOURS[2], 1.4),
    "gsa_gpf, 100": plotting.Look("GSA-GPF", COLOURS[3], 1.4),
}
OTHERS: Final = {
    "gsa_gpf, 100, greedy": plotting.Look("GSA-GPF, greedy", COLOURS[4], 1.0),
    "pf, 5000": plotting.Look("PF, 5000 particles", COLOURS[5], 1.0),
    "ekf": plotting.Look("EKF", plotting.GREY, 1.0),
}
BASE: Final = "pf, 100"
MARGIN: Final = 0.7
"""Metres shown around the tracks."""


def _tracks(figure: Figure, data: Data) -> None:
    """One run from above: the filters as printed, and repairs and references."""
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, looks, title in zip(
        panels, (PRINTED, OTHERS), ("as printed, N = 100", "repaired, and references"), strict=True
    ):
        _room(axes, data)
        plotting.tracks(axes, data, looks, rmse=True)
        axes.set_title(title, loc="left")
    panels[1].set_ylabel("")
    (x_low, y_low), (x_high, y_high) = _extent(data)
    panels[0].set(xlim=(x_low, x_high), ylim=(y_low, y_high))
    plotting.legend_below(figure, panels)


def _room(axes: Axes, data: Data) -> None:
    """The room, its anchors and the ground truth."""
    truth = plotting.first_run(data, BASE, "truth").sort_values("step")[["px", "py"]].to_numpy()
    deploy: Any = data.scenario(BASE)["deploy"]
    wide, high = deploy["width"], deploy["height"]
    axes.plot([0, wide, wide, 0, 0], [0, 0, high, high, 0], color=plotting.GREY, linewidth=1.0, label="room")
    plotting.points(axes, np.array(deploy["places"]), "^", 7, "anchors")
    axes.plot(*truth.T, color=plotting.BLACK, linewidth=2.0, label="truth")
    plotting.points(axes, truth[0], "o", 5, "start")


def _extent(data: Data) -> tuple[Floats, Floats]:
    """The lower left and the upper right corner of the truth and all estimates of replicate 0, with a margin."""
    tables = [
        plotting.first_run(data, BASE, "truth"),
        *(plotting.first_run(data, name, "estimates") for name in PRINTED | OTHERS),
    ]
    places = np.concatenate([table[["px", "py"]].to_numpy(dtype=np.float64) for table in tables])
    return np.fmin.reduce(places) - MARGIN, np.fmax.reduce(places) + MARGIN


def _errors(figure: Figure, data: Data, published: bool) -> None:
    """Errors at each step: of one run, and the RMSE over all runs."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    for variant, look in (PRINTED | OTHERS).items():
        error = data.errors(variant)[0]
        left.plot(plotting.times(data, variant, len(error)), error, color=look.colour, linewidth=look.width)
    runs = plotting.rmse_curves(right, data, PRINTED | OTHERS, plotting.mean_and_lost(data))
    for variant, look in PRINTED.items() if published else ():
        level = data.published["rmse"][variant.split(",")[0]]["100"]
        plotting.published_level(right, level, f"{look.name}, published mean: {level:.2f} m", look.colour)
    bound = data.bound(BASE, "per_trajectory")
    plotting.bound_curve(
        right, bound.rmse, data.scenario(BASE)["step"], f"trajectory-conditional bound: mean {bound.time_mean:.2f} m"
    )
    left.set(xlabel="time [s]", ylabel="position error [m]")
    left.set_title("replicate 0", loc="left")
    right.set_title(f"RMSE over {runs_text(runs)}", loc="left")
    plotting.plain_numbers(left)
    plotting.legend_below(figure, (right,))


FIGURES: Final[plotting.Drawings] = {
    "figure_1": _tracks,
    "figure_2": partial(_errors, published=True),
    "figure_4": _tracks,
    "figure_5": partial(_errors, published=False),
}
