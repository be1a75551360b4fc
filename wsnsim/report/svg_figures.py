"""The figures of a result, and the plots of a campaign, as SVG, each on its own, to be placed in a page.

Text stays text, in the page's font. Figures with very many marks contain an image of them.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, NullFormatter

from wsnsim.analysis import error_bounds, plot_data, sweep_plots
from wsnsim.analysis.figure_style import STYLE, Panel, titled
from wsnsim.analysis.figures import SWEPT, PlotSelection, panels_of
from wsnsim.analysis.multi_target import is_unlabelled
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.runs import tracked
from wsnsim.recording import read_table
from wsnsim.recording.folder import Folder

MANY: Final = 3000
"""Marks above which they are drawn as an image (our choice)."""
SIZE: Final = (4.0, 3.1)
"""Inches, so that letters can be read on a phone's screen (our choice)."""
ORDER: Final = ("track", "gospa", "error", "consistency", "energy", "particles", "states")
"""The figures of a result, the most important first."""
MAX_TARGETS: Final = 4
"""Targets whose tracks get a figure (our choice)."""
PAGE_STYLE: Final = {
    **STYLE,
    "svg.fonttype": "none",
    "text.parse_math": False,
    "path.simplify_threshold": 0.5,
    "savefig.dpi": 110,
}


class SvgFigure(NamedTuple):
    """A figure: its name, its description, and its SVG."""

    name: str
    label: str
    svg: str


def svg_figures(path: Path, replicate: int, plugins: bool = False) -> tuple[list[SvgFigure], list[str]]:
    """(figures of a result, the most important first; reasons for the missing ones).

    `plugins` says whether plug-ins that the result's scenario names are imported for the bound.
    """
    reasons = {name: plot_data.lacking(path, name) for name in plot_data.plots_of(path)}
    by_reason = {reason: [n for n, each in reasons.items() if each == reason] for reason in reasons.values() if reason}
    left_out = [f"without {', '.join(names)}: {reason}" for reason, names in by_reason.items()]
    if why := error_bounds.lacking(path, plugins):
        left_out.append(why)
    figures = []
    possible = {name for name, reason in reasons.items() if not reason}
    targets = []
    if "track" in possible:
        truth = read_table(path, "truth", ["replicate", "target"])
        targets = np.unique(truth["target"][truth["replicate"] == replicate]).tolist()
        targets = [0] if is_unlabelled(path) else targets  # one figure shows them all
    if len(targets) > MAX_TARGETS:
        left_out.append(f"only the tracks of the first {MAX_TARGETS} of {len(targets):,} targets are drawn")
    panels = list(_panels(path, replicate, possible, targets, plugins))
    for panel in tracked(panels, f"figures of {path.name} drawn"):
        try:
            figures.append(svg_of(*panel))
        except (ResultError, UsageError) as error:
            left_out.append(f"without {panel[0]}: {error}")
    return figures, left_out


def _panels(
    path: Path, replicate: int, possible: set[str], targets: list[int], plugins: bool
) -> Iterator[tuple[str, Panel, int | None]]:
    """The arguments of `svg_of` for each figure to draw."""
    of_targets = {"track": targets[:MAX_TARGETS], "particles": targets[:1], "states": targets[:1]}
    for name in (name for name in ORDER if name in possible):
        for target in of_targets.get(name, [0]):
            chosen = PlotSelection(replicate=replicate, target=target, plugins=plugins)
            for title, draw in panels_of(path, name, chosen, among_all=True):
                yield title, draw, target if len(targets) > 1 and name in of_targets else None


def svg_of(name: str, draw: Panel, target: int | None = None) -> SvgFigure:
    """A figure of one panel, its SVG without prologue and date, so that the same figure gives the same text.

    Args:
        name: its name.
        draw: draws the panel.
        target: the target that is shown; its title names it.
    """
    with style.context(["default", PAGE_STYLE]):
        figure, text = Figure(figsize=SIZE, layout="constrained"), io.StringIO()
        axes = draw(figure.subplots())
        if target is not None and not (title := axes.get_title(loc="left")).endswith(f", target {target}"):
            titled(axes, f"{title}, target {target}")
        if isinstance(axes.yaxis.get_major_formatter(), LogFormatter):  # its powers of ten are formulas, not text
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(NullFormatter())
        for artist in axes.get_children():
            if _marks(artist) > MANY:
                artist.set_rasterized(True)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = text.getvalue()
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    return SvgFigure(name, axes.get_title(loc="left"), svg)


def _marks(artist: Any) -> int:
    """The number of marks or corners of an artist."""
    if isinstance(artist, PathCollection):
        return len(np.asarray(artist.get_offsets()))
    if isinstance(artist, PolyCollection):
        return sum(int(np.asarray(path.vertices).shape[0]) for path in artist.get_paths())
    return 0


def sweep_svgs(folder: Folder, metric: str = "rmse", key: str | None = None) -> tuple[list[SvgFigure], dict[str, str]]:
    """Plot a campaign over one of its keys: a metric, energy, lost runs and paired differences.

    Returns:
        The figures, and {name of a plot: why it cannot be drawn}.

    Raises:
        UsageError: the campaign does not vary the key, or there is no such metric.
        ResultError: there are no results yet.
    """
    lines = sweep_plots.lines_of(folder, metric, key)
    left_out = sweep_plots.lacking(lines)
    names = [name for name in SWEPT if name not in left_out]
    return [svg_of(name, partial(getattr(sweep_plots, name), lines=lines)) for name in names], left_out
