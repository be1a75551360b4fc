"""A figure that somebody else draws, in the house's style, written as a picture.

panels(draw, out, size) -> out            draw(figure) puts axes on it and draws
band(axes, x, rows, label, ...)           median over runs with the band between quartiles, and their number
rmse_band(axes, x, rows, label, ...)      RMSE over runs, with its 95 % band
rmse_interval(rows) -> (low, high)        that band
with_bands(runs, whose) -> str            how a title counts the runs that such bands are of
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wsnsim.analysis.figures import STYLE, save
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito (2008): told apart by all kinds of eyes."""
PUBLISHED: Final[dict[str, Any]] = {"color": "#666666", "linestyle": "--", "linewidth": 1.0}
"""How a published value is drawn."""
BOUND: Final[dict[str, Any]] = {"color": "#000000", "linestyle": ":", "linewidth": 1.2}
"""How a bound is drawn."""
LEAST: Final = 5
"""Runs from which on there is a band, as there is an interval in `metrics.bootstrap_interval`."""
DRAWS: Final = 400
"""Of a bootstrap."""


def panels(draw: Callable[[Figure], None], out: Path, size: tuple[float, float], title: str = "") -> Path:
    """Write a figure that `draw` draws. Errors: ResultError if it cannot be written."""
    with style.context(["default", STYLE]):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        save(figure, out)
    return out


def band(axes: Axes, x: Floats, rows: Floats, label: str, colour: str) -> Axes:
    """The median over the rows (runs, len(x)), and the band between their quartiles; the label says how many runs."""
    low, middle, high = np.nanquantile(rows, [0.25, 0.5, 0.75], axis=0)
    runs = f"{len(rows)} runs" if len(rows) > 1 else "one run"
    axes.plot(x, middle, color=colour, linewidth=1.2, label=f"{label} (median and quartiles of {runs})")
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
    return axes


def rmse_band(
    axes: Axes, x: Floats, rows: Floats, label: str, colour: str, width: float = 1.4, banded: bool = True
) -> Axes:
    """The RMSE over the rows (runs, len(x)), and, where it is to be banded, its 95 % band.

    Curves choose how far down the axes go: what a band has beneath them is cut, as on a logarithmic scale it goes far.
    """
    axes.plot(x, metrics.per_step_rmse(rows), color=colour, linewidth=width, label=label)
    if not banded:
        return axes
    low, high = rmse_interval(rows)
    known = np.isfinite(high)
    if known.any():
        seen = axes.dataLim.frozen()
        axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.dataLim.set(seen)
        axes.update_datalim(np.column_stack([x, high])[known])
    return axes


def rmse_interval(rows: Floats, draws: int = DRAWS) -> tuple[Floats, Floats]:
    """The percentile bootstrap's 95 % interval of the RMSE over the rows (runs, steps) at each step: (low, high).

    NaN at a step at which fewer than five runs have an estimate. Whole runs are drawn, the same for as many rows. A
    draw without a run that has an estimate at a step does not count there.
    """
    count, known = len(rows), np.isfinite(rows)
    low, high = np.full((2, rows.shape[1]), np.nan)
    enough = known.sum(axis=0) >= LEAST
    if not enough.any():
        return low, high
    square = np.where(known, rows, 0.0)[:, enough] ** 2
    rng = np.random.Generator(np.random.Philox(count))
    taken = rng.multinomial(count, np.full(count, 1.0 / count), size=draws).astype(np.float64)
    with np.errstate(invalid="ignore"):
        drawn = np.sqrt(taken @ square / (taken @ known[:, enough]))
    low[enough], high[enough] = np.nanquantile(drawn, [0.025, 0.975], axis=0)
    return low, high


def with_bands(runs: int, whose: str = "") -> str:
    """The number of runs, and what the bands around their RMSE are if there are any, and whose if not all have one."""
    if runs < LEAST:
        return f"{runs} runs" if runs > 1 else "one run"
    return f"{runs} runs (bands{f' of {whose}' if whose else ''}: 95 %)"
