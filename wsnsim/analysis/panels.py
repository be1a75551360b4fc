"""A figure that somebody else draws, in the house's style, written as a picture.

panels(draw, out, size) -> out            draw(figure) puts axes on it and draws
band(axes, x, rows, label, ...)           median over runs with the band between quartiles, and their number
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
from wsnsim.base.arrays import Floats

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito (2008): told apart by all kinds of eyes."""
PUBLISHED: Final[dict[str, Any]] = {"color": "#666666", "linestyle": "--", "linewidth": 1.0}
"""How a published value is drawn."""
BOUND: Final[dict[str, Any]] = {"color": "#000000", "linestyle": ":", "linewidth": 1.2}
"""How a bound is drawn."""


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
