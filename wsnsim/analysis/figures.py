"""One figure of all that a result, or a campaign, can show, or of one thing, written as a picture.

draw(path, out, what, choice) -> WrittenFigure              as `wsnsim plot FILE`
draw_campaign(folder, out, metric, key) -> WrittenFigure    as `wsnsim plot DIR`

No display is used, and the same result gives the same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any, Final

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wsnsim.analysis import plot_data, plots, sweep_plots
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.recording.folder import Folder

TAKES: Final = {
    "all": ("column", "step", "replicate", "target"),
    "track": ("replicate", "target"),
    "states": ("column", "replicate", "target"),
    "error": (),
    "energy": (),
    "particles": ("column", "step", "replicate", "target"),
}
"""What can be drawn, and what can be chosen of it."""
UNDATED: Final[dict[str, dict[str, Any]]] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
"""The suffixes of pictures, and what keeps the date out of each."""
STYLE: Final = {
    "svg.hashsalt": "wsnsim",
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "legend.fontsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "savefig.dpi": 150,
}
SWEPT: Final = ("median", "energy", "differences", "lost")
"""What can be drawn of a campaign: differences stand beneath what they are of, where there is energy beside it."""
Draws = Callable[[Axes], Axes]


@dataclass(frozen=True)
class WrittenFigure:
    """A picture that was written: what it shows, and why it lacks the rest."""

    out: Path
    shown: tuple[str, ...]
    left_out: dict[str, str]


@dataclass(frozen=True)
class PlotSelection:
    """Of what a picture is: a state column, a step of particles (None: the last), a replicate and a target."""

    column: str | None = None
    step: int | None = None
    replicate: int = 0
    target: int = 0


def draw(path: Path, out: Path, what: str = "all", choice: PlotSelection | None = None) -> WrittenFigure:
    """Draw what a result shows, as a picture whose form its suffix says (.png, .svg, .pdf).

    Raises:
        UsageError: the result has no such column, replicate, target or step, or the suffix is another.
        ResultError: a table that `what` needs was not recorded, or the picture cannot be written.
    """
    suffix_of(out)
    chosen = choice or PlotSelection()
    if chosen.column is not None:
        plot_data.layout(path).check(path, chosen.column)
    wanted = tuple(plot_data.NEEDS) if what == "all" else (what,)
    reasons = {name: plot_data.lacking(path, name) for name in wanted}
    left_out = {name: reason for name, reason in reasons.items() if reason}
    if len(left_out) == len(wanted):
        raise ResultError(f"{path}: cannot draw {what}: {'; '.join(dict.fromkeys(left_out.values()))}")
    panels = [panel for name in wanted if not reasons[name] for panel in _panels(path, name, chosen, what == "all")]
    with style.context(["default", STYLE]):
        figure = figure_of([draws for _, draws in panels])
        figure.suptitle(plot_data.heading(path), x=0.01, ha="left", fontweight="bold")
        save(figure, out)
    return WrittenFigure(out, tuple(name for name, _ in panels), left_out)


def draw_campaign(folder: Folder, out: Path, metric: str = "rmse", key: str | None = None) -> WrittenFigure:
    """Draw what a campaign shows over one of its keys: a metric, energy, lost runs, and paired differences.

    Raises:
        UsageError: the campaign varies no such key, the metric is none, or the suffix is another.
        ResultError: there are no results yet, or the picture cannot be written.
    """
    suffix_of(out)
    lines = sweep_plots.lines_of(folder, metric, key)
    left_out = sweep_plots.lacking(lines)
    panels = {name: getattr(sweep_plots, name) for name in SWEPT if name not in left_out}
    with style.context(["default", STYLE]):
        figure = figure_of([partial(panel, lines=lines, legend=False) for panel in panels.values()])
        figure.suptitle(f"{lines.found.name}, {lines.runs} a point", x=0.01, ha="left", fontweight="bold")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower left", ncols=min(4, len(handles)), frameon=False)
        save(figure, out)
    return WrittenFigure(out, tuple(panels), left_out)


def figure_of(panels: list[Draws]) -> Figure:
    """A figure with a panel for each function that draws on an Axes, in one or two columns."""
    across = min(len(panels), 2)
    down = ceil(len(panels) / across)
    size = (5.4 * across, 3.6 * down) if across > 1 else (6.4, 4.6)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    cells = figure.subplots(down, across, squeeze=False).ravel()
    for cell, panel in zip(cells, panels, strict=False):
        panel(cell)
    for cell in cells[len(panels) :]:
        cell.remove()
    return figure


def save(figure: Figure, out: Path) -> None:
    """Write a figure; its file has its name only once it is complete."""
    suffix = suffix_of(out)
    unfinished = out.with_name(f"{out.name}.{os.getpid()}.tmp")
    try:
        figure.savefig(unfinished, format=suffix[1:], metadata=UNDATED[suffix])
        unfinished.replace(out)
    except OSError as error:
        raise ResultError(f"{out}: cannot be written: {error.strerror or error}") from error
    finally:
        unfinished.unlink(missing_ok=True)


def suffix_of(out: Path) -> str:
    """The suffix of a picture, in small letters. Raises UsageError if it is none that can be written."""
    suffix = out.suffix.lower()
    if suffix not in UNDATED:
        hint = did_you_mean(suffix, UNDATED) if suffix else "known: " + ", ".join(UNDATED)
        raise UsageError(f"{out}: a picture cannot have the suffix '{suffix}' ({hint})")
    return suffix


def _panels(path: Path, what: str, choice: PlotSelection, among_all: bool) -> Iterator[tuple[str, Draws]]:
    """What is drawn of one thing: a name and a function for each panel."""
    replicate, target = choice.replicate, choice.target
    match what:
        case "track":
            yield what, lambda axes: plots.track(axes, path, replicate, target)
        case "states":
            for column in _columns(plot_data.layout(path), choice.column, among_all):
                yield f"state {column}", partial(_state, path, column, replicate, target)
        case "error":
            yield what, lambda axes: plots.error(axes, path)
        case "energy":
            yield what, lambda axes: plots.energy(axes, path)
        case "particles":
            last = plot_data.last_step_with_particles(path, replicate, target) if choice.step is None else choice.step
            yield what, lambda axes: plots.particles(axes, path, last, choice.column, replicate, target)


def _state(path: Path, column: str, replicate: int, target: int, axes: Axes) -> Axes:
    return plots.states(axes, path, column, replicate, target)


def _columns(plan: plot_data.StateLayout, wanted: str | None, among_all: bool) -> tuple[str, ...]:
    """The state columns to draw: the one wanted, or all; none beside a track that shows the only one over time."""
    if wanted is not None:
        return (wanted,)
    return () if among_all and tuple(plan.units) == plan.position else tuple(plan.units)
