"""The figure of information_driven beside the bound: its error over time, its consistency by distance from a wall."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import BLUE, BOUND, VERMILLION
from wsnsim.base import metrics
from wsnsim.papers.frontier.against_bound import squares
from wsnsim.papers.frontier.consistency import DIMENSIONS, nees_of_steps, true_positions
from wsnsim.papers.measures import Data
from wsnsim.papers.plotting import GREY

WIDTH: Final = 5.0
"""Metres of a bin of the distance from a wall."""
LEAST: Final = 50
"""Steps that a bin must have."""


def at_the_bound(figure: Figure, data: Data) -> None:
    """The RMSE over runs at each step beside the bound, and the mean NEES by distance from the nearest wall."""
    upper, lower = figure.subplots(2, 1)
    _errors(upper, data)
    _consistency(lower, data)


def _errors(axes: Axes, data: Data) -> None:
    variant = data.variants[0]
    found = squares(data, variant)
    for values, look in ((found.errors, {"color": BLUE, "label": "information_driven"}),
                         (found.bounds, {**BOUND, "label": "bound for all readings in range"})):  # fmt: skip
        axes.plot(found.times, metrics.per_step_rmse(np.sqrt(values)), **look)
    axes.set(yscale="log", xlabel="time [s]", ylabel="RMSE over runs [m]", xlim=(0.0, None))
    axes.set_title(f"{variant}, {len(found.runs)} runs", loc="left")
    axes.legend(frameon=False)


def _consistency(axes: Axes, data: Data) -> None:
    variant = data.variants[0]
    wall = data.scenario(variant)["motion"]["bound"]
    away = (wall - np.abs(true_positions(data, variant))).min(axis=2)
    bins = np.floor(away / WIDTH).astype(np.int64)
    for of, colour in zip(DIMENSIONS, (BLUE, VERMILLION), strict=True):
        values = nees_of_steps(data, variant, of)
        known = np.isfinite(values)
        places = [one for one in np.unique(bins[known]) if (known & (bins == one)).sum() >= LEAST]
        means = [values[known & (bins == one)].mean() / DIMENSIONS[of] for one in places]
        axes.plot((np.array(places) + 0.5) * WIDTH, means, ".-", color=colour, label=f"of the {of}")
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    axes.set(yscale="log", xlabel="distance of the target from the nearest wall [m]; negative: beyond it",
             ylabel="mean NEES per coordinate")  # fmt: skip
    axes.legend(frameon=False)
