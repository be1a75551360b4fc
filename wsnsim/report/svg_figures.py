"""A result's figures as SVG, one each, to stand in a page.

pictures(path, replicate) -> (figures, reasons for those that are missing)

The text stays text, in the page's own type. What has very many marks is drawn as an image within the figure.
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
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from wsnsim.analysis import plot_data, plots
from wsnsim.analysis.figure_style import STYLE, Draws
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.recording import read_table

MANY: Final = 3000
"""Marks from which on they are drawn as an image (our choice)."""
SIZE: Final = (5.2, 3.7)
MARGINS: Final = {"left": 0.15, "right": 0.97, "bottom": 0.13, "top": 0.84}
"""Room for two rows of a legend and a title; fixed, as finding it takes as long as drawing."""
MOST_TARGETS: Final = 4
"""Targets whose ways get a figure each (our choice)."""
ACROSS: Final = 3
"""Words of a legend in a row: a figure is as narrow as a telephone (our choice)."""
IN_PAGE: Final = {
    **STYLE,
    "svg.fonttype": "none",
    "text.parse_math": False,
    "path.simplify_threshold": 0.5,
    "savefig.dpi": 110,
}


class Picture(NamedTuple):
    """A figure: its name, what it shows in words, and itself."""

    name: str
    label: str
    svg: str


def pictures(path: Path, replicate: int) -> tuple[list[Picture], list[str]]:
    """Every figure that a result has, the most important first; and why the others are missing."""
    reasons = {name: plot_data.lacking(path, name) for name in plot_data.NEEDS}
    told = {reason: [n for n, each in reasons.items() if each == reason] for reason in reasons.values() if reason}
    left_out = [f"without {', '.join(names)}: {reason}" for reason, names in told.items()]
    drawn = []
    known = {name for name, reason in reasons.items() if not reason}
    targets = _targets(path, replicate) if "track" in known else []
    if len(targets) > MOST_TARGETS:
        left_out.append(f"only the tracks of the first {MOST_TARGETS} of {len(targets):,} targets are drawn")
    with style.context(["default", IN_PAGE]):
        for name, draws in _panels(path, replicate, known, targets):
            try:
                drawn.append(_drawn(name, draws, len(targets) > 1))
            except (ResultError, UsageError) as error:
                left_out.append(f"without {name}: {error}")
    return drawn, left_out


def _panels(path: Path, replicate: int, known: set[str], targets: list[int]) -> Iterator[tuple[str, Draws]]:
    """What is drawn: a name and a function for each figure."""
    for target in targets[:MOST_TARGETS]:
        yield "track", partial(plots.track, path=path, replicate=replicate, target=target)
    if "error" in known:
        yield "error", partial(plots.error, path=path)
    if "energy" in known:
        yield "energy", partial(plots.energy, path=path)
    if "particles" in known and targets:
        last = plot_data.last_step_with_particles(path, replicate, targets[0])
        yield "particles", partial(plots.particles, path=path, step=last, replicate=replicate, target=targets[0])
    plan = plot_data.layout(path) if targets else None
    for column in plan.units if plan and tuple(plan.units) != plan.position else ():
        yield f"state {column}", partial(plots.states, path=path, column=column, replicate=replicate, target=targets[0])


def _targets(path: Path, replicate: int) -> list[int]:
    """The targets of a run, if it has any."""
    held = read_table(path, "truth", ["replicate", "target"])
    return [int(target) for target in np.unique(held["target"][held["replicate"] == replicate])]


def _drawn(name: str, draws: Any, several: bool) -> Picture:
    """One figure as SVG, without the prologue that a page does not take; of `several` targets it names its own."""
    figure = Figure(figsize=SIZE)
    FigureCanvasAgg(figure)
    axes = figure.subplots(gridspec_kw=MARGINS)
    draws(axes)
    if several and "target" in draws.keywords:
        _named(axes, draws.keywords["target"])
    _narrow(axes)
    if axes.get_yscale() == "log":  # as plain text: the powers of ten are formulas
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    for artist in axes.get_children():
        if _marks(artist) > MANY:
            artist.set_rasterized(True)
    held = io.StringIO()
    figure.savefig(held, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = held.getvalue()
    label = axes.get_title(loc="left")
    return Picture(name, label, re.sub(r"\s*<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.S))


def _named(axes: Axes, target: int) -> None:
    """A title that names the target, the first one, too."""
    title = axes.get_title(loc="left")
    if not title.endswith(f", target {target}"):
        axes.set_title(f"{title}, target {target}", loc="left", pad=20)


def _narrow(axes: Axes) -> None:
    """A legend of many words in several rows, above which the title stands."""
    handles, labels = axes.get_legend_handles_labels()
    if len(handles) <= ACROSS:
        return
    rows = -(-len(handles) // ACROSS)
    axes.set_title(axes.get_title(loc="left"), loc="left", pad=8 + 12 * rows)
    axes.legend(
        handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=ACROSS, frameon=False, borderaxespad=0.1,
        borderpad=0.2, handlelength=1.4, columnspacing=1.0, labelspacing=0.2,
    )  # fmt: skip


def _marks(artist: Any) -> int:
    """How many marks or corners an artist has."""
    if isinstance(artist, PathCollection):
        return len(np.asarray(artist.get_offsets()))
    if isinstance(artist, PolyCollection):
        return sum(int(np.asarray(path.vertices).shape[0]) for path in artist.get_paths())
    return 0
