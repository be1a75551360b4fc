"""What the figures of all papers share: curves of the RMSE, tracks, published values, legends and axes.

Where a single run is shown, it is replicate 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogLocator, NullLocator

from wsnsim.analysis.figure_style import BOUND, PUBLISHED, rmse_band
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data

Drawings: TypeAlias = Mapping[str, Callable[..., None]]
"""The functions (figure, data) that draw a paper's figures, by name."""
GREY: Final = "#8C8C8C"
BLACK: Final = "#000000"


class Look(NamedTuple):
    """The name and the line of a variant in a figure; a 95 % band around its RMSE where it is `banded`."""

    name: str
    colour: str
    width: float = 1.2
    banded: bool = True


def first_run(data: Data, variant: str, table: str) -> pd.DataFrame:
    """The rows of replicate 0."""
    frame = data.of(variant, table)
    return frame[frame["replicate"] == 0]


def times(data: Data, variant: str, steps: int) -> Floats:
    """(steps,) the times (s) of the steps 1, 2, ..."""
    return np.arange(1, steps + 1, dtype=np.float64) * float(data.scenario(variant)["step"])


def rmse_curves(
    axes: Axes,
    data: Data,
    looks: Mapping[str, Look],
    label: Callable[[str, Floats], str] = lambda _, __: "",
    errors: Callable[[str], Floats] | None = None,
) -> int:
    """Draw the RMSE over runs at each step, one curve for each variant; the number of runs.

    Args:
        axes: where to draw, with a logarithmic scale.
        data: the results.
        looks: the variants.
        label: what stands behind a variant's name in the legend, given its errors (runs, steps).
        errors: the errors of a variant; by default those of the position.
    """
    for variant, look in looks.items():
        rows = (errors or data.errors)(variant)
        name = look.name + label(variant, rows)
        rmse_band(axes, times(data, variant, rows.shape[1]), rows, name, look.colour, look.width, look.banded)
    axes.set(yscale="log", xlabel="time [s]", xlim=(0, None))
    return len(rows)


def mean_and_lost(data: Data) -> Callable[[str, Floats], str]:
    """A label of rmse_curves: the time-averaged RMSE, and the number of runs that ever lost a track."""

    def label(variant: str, rows: Floats) -> str:
        return f": mean {metrics.time_mean_rmse(rows):.2f} m" + lost_runs(data)(variant, rows)

    return label


def lost_runs(data: Data) -> Callable[[str, Floats], str]:
    """A label of rmse_curves: the number of runs that ever lost a track, and when one is lost, if there are any."""

    def label(variant: str, rows: Floats) -> str:
        lost = int(data.lost(variant).sum())
        return f" ({lost} of {len(rows)} lost: {data.loss_rule(variant)})" if lost else ""

    return label


def bound_curve(axes: Axes, bound: Floats, step: float, label: str, linestyle: str = ":") -> None:
    """Draw a bound at each step."""
    axes.plot(step * np.arange(1, len(bound) + 1), bound, label=label, **{**BOUND, "linestyle": linestyle})


def published_level(axes: Axes, level: float, label: str | None = None, colour: str = "#666666") -> None:
    """Draw a published value as a horizontal line."""
    axes.axhline(level, label=label, **{**PUBLISHED, "color": colour})


def tracks(axes: Axes, data: Data, looks: Mapping[str, Look], rmse: bool = False) -> None:
    """Draw the estimates of one run on a map, one track for each variant; `rmse` adds that of the run to the legend."""
    for variant, look in looks.items():
        run = first_run(data, variant, "estimates").sort_values("step")
        label = f"{look.name} (RMSE of this run {metrics.rmse(run['error'].to_numpy()):.2f} m)" if rmse else look.name
        axes.plot(run["px"], run["py"], color=look.colour, linewidth=1.0, label=label)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


def points(axes: Axes, places: Floats, marker: str, size: float, label: str, colour: str = BLACK) -> None:
    """Draw positions (n, 2) or (2,) as markers."""
    axes.plot(*np.atleast_2d(places).T, marker, color=colour, markersize=size, linestyle="", label=label)


def whole_run(axes: Axes, frame: pd.DataFrame) -> None:
    """Let the axis of time show the whole run."""
    axes.set(xlabel="time [s]", xlim=(0.0, float(frame["time"].max())))


def plain_numbers(axes: Axes, places: Iterable[float] | None = None) -> None:
    """Label a logarithmic axis with plain numbers: at these places, or at three in each decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if places is None else FixedLocator([*places]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))


def legend_below(figure: Figure, panels: Iterable[Axes], columns: int = 3, title: str | None = None) -> None:
    """Put one legend for all panels below them, each entry once."""
    entries = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        entries.values(), entries.keys(), loc="outside lower center", ncols=columns, frameon=False, title=title
    )


def legend_beside(axes: Axes) -> None:
    """Put a legend to the right of the axes."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
