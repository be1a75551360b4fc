"""The plots of a campaign as SVG files, each on its own, of the runs that are on disk."""

from __future__ import annotations

import io
from typing import Final, NamedTuple

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wsnsim.analysis import sweep_plots
from wsnsim.recording.folder import Folder
from wsnsim.report.svg_figures import PAGE_STYLE, SIZE

PLOTS: Final = ("median", "energy", "lost", "differences")


class SweepSvgs(NamedTuple):
    """{name of a plot: (its title, its SVG)}, and {name of a plot: why it cannot be drawn}."""

    drawn: dict[str, tuple[str, str]]
    left_out: dict[str, str]


def sweep_svgs(folder: Folder, metric: str = "rmse", key: str | None = None) -> SweepSvgs:
    """Plot a campaign over one of its keys: a metric, energy, lost runs and paired differences.

    Raises:
        UsageError: the campaign does not vary the key, or there is no such metric.
        ResultError: there are no results yet.
    """
    lines = sweep_plots.lines_of(folder, metric, key)
    left_out = sweep_plots.lacking(lines)
    drawn = {}
    with style.context(["default", PAGE_STYLE]):
        for name in PLOTS:
            if name not in left_out:
                figure = Figure(figsize=SIZE, layout="constrained")
                FigureCanvasAgg(figure)
                axes = getattr(sweep_plots, name)(figure.subplots(), lines)
                text = io.StringIO()
                figure.savefig(text, format="svg", metadata={"Date": None})
                drawn[name] = (axes.get_title(loc="left"), text.getvalue())
    return SweepSvgs(drawn, left_out)
