"""Figures of a result or a campaign, written to a file.

draw(path, out, what, choice) -> WrittenFigure              as `wsnsim plot FILE`
draw_campaign(folder, out, metric, key) -> WrittenFigure    as `wsnsim plot DIR`

No display is used, and the same result gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from wsnsim.analysis import error_bounds, plot_data, plots, sweep_plots
from wsnsim.analysis.figure_style import GIF, STYLE, WIDTHS, Panel, figure_of, save, suffix_of
from wsnsim.base.errors import ResultError
from wsnsim.recording.atomic_files import replacing
from wsnsim.recording.folder import Folder

TAKES: Final = {
    "all": ("column", "step", "replicate", "target"),
    "track": ("replicate", "target"),
    "states": ("column", "replicate", "target"),
    "gospa": (),
    "error": (),
    "consistency": (),
    "energy": (),
    "particles": ("column", "step", "replicate", "target"),
    "step": ("step", "replicate", "target"),
}
"""What can be plotted, and which options apply to it."""
SWEPT: Final = ("median", "energy", "differences", "lost")
"""The panels of a campaign in their order: differences are below the metric that they are of."""


@dataclass(frozen=True)
class WrittenFigure:
    """A figure that was written.

    Attributes:
        out: the file.
        shown: names of its panels.
        left_out: {name: why there is no such panel}.
    """

    out: Path
    shown: tuple[str, ...]
    left_out: dict[str, str]


@dataclass(frozen=True)
class PlotSelection:
    """What to plot: a state column (None: all), a step of particles (None: the last), a run and a target.

    `plugins` says whether plug-ins that the result's scenario names are imported for the bound; `width` is
    that of a figure for a paper in inches, None: for a screen.
    """

    column: str | None = None
    step: int | None = None
    replicate: int = 0
    target: int = 0
    plugins: bool = False
    width: float | None = None


def draw(path: Path, out: Path, what: str = "all", choice: PlotSelection | None = None) -> WrittenFigure:
    """Plot a result.

    Args:
        path: the result file.
        out: the figure's file; its suffix is the format (.png, .svg, .pdf; .gif for the steps of a run).
        what: a key of `TAKES`.
        choice: the column, step, run and target to plot.

    Raises:
        UsageError: the result has no such column, replicate, target or step, or the suffix is unknown.
        ResultError: a table that `what` needs was not recorded, or the figure cannot be written.
    """
    chosen = choice or PlotSelection()
    if suffix_of(out, what == "step" and chosen.step is None) == GIF:
        return _animation(path, out, chosen)
    if chosen.column is not None:
        plot_data.layout(path).check(path, chosen.column)
    wanted = plot_data.plots_of(path) if what == "all" else (what,)
    reasons = {name: plot_data.lacking(path, name) for name in wanted}
    left_out = {name: reason for name, reason in reasons.items() if reason}
    if len(left_out) == len(wanted):
        raise ResultError(f"{path}: cannot plot {what}: {'; '.join(dict.fromkeys(left_out.values()))}")
    panels = [panel for name in wanted if not reasons[name] for panel in panels_of(path, name, chosen, what == "all")]
    with style.context(["default", STYLE]):
        figure = figure_of([draws for _, draws in panels], chosen.width)
        if chosen.width is None:
            figure.suptitle(plot_data.heading(path), x=0.01, ha="left", fontweight="bold")
        save(figure, out)
    if "error" in dict(panels) and (why := error_bounds.lacking(path, chosen.plugins)):
        left_out["bound"] = why
    return WrittenFigure(out, tuple(name for name, _ in panels), left_out)


MOST_PICTURES: Final = 60
"""Pictures of an animation (our choice)."""
PICTURE_TIME: Final = 150
"""Milliseconds of a picture."""


def _animation(path: Path, out: Path, chosen: PlotSelection) -> WrittenFigure:
    """Write the steps of a run as an animated GIF."""
    plot_data.demand(path, "step")
    steps = np.unique(plot_data.course(path, ("step",), chosen.replicate, chosen.target)[0]["step"])
    kept = steps[np.unique(np.linspace(0, len(steps) - 1, min(len(steps), MOST_PICTURES)).astype(int))].tolist()
    pictures = []
    panel = partial(plots.step, path=path, replicate=chosen.replicate, target=chosen.target)
    with style.context(["default", STYLE, {"figure.dpi": 100}]):
        figure = figure_of([partial(panel, step=kept[0])], chosen.width)
        canvas: Any = FigureCanvasAgg(figure)
        for step in kept:
            figure.axes[0].clear()
            panel(figure.axes[0], step=step)
            canvas.draw()
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("P"))
    with replacing(out) as unfinished:
        pictures[0].save(unfinished, "GIF", save_all=True, append_images=pictures[1:], duration=PICTURE_TIME, loop=0)
    return WrittenFigure(out, (f"{len(kept)} of {len(steps)} steps",), {})


def draw_campaign(
    folder: Folder, out: Path, metric: str = "rmse", key: str | None = None, width: float | None = None
) -> WrittenFigure:
    """Plot a campaign over one of its keys: a metric, energy, lost fraction and paired differences.

    At the width of a column the metric stands alone, so that the figure fits a page.

    Raises:
        UsageError: the campaign does not vary the key, there is no such metric, or the suffix is unknown.
        ResultError: there are no results yet, or the figure cannot be written.
    """
    suffix_of(out)
    lines = sweep_plots.lines_of(folder, metric, key)
    shown = SWEPT[:1] if width == WIDTHS["column"] else SWEPT
    left_out = {name: why for name, why in sweep_plots.lacking(lines).items() if name in shown}
    panels = {name: getattr(sweep_plots, name) for name in shown if name not in left_out}
    with style.context(["default", STYLE]):
        figure = figure_of([partial(panel, lines=lines, legend=False) for panel in panels.values()], width)
        if width is None:
            figure.suptitle(f"{lines.found.name}, {lines.runs} per point", x=0.01, ha="left", fontweight="bold")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if handles:
            figure.legend(
                handles,
                labels,
                loc="outside lower left",
                ncols=min(4 if width is None else 1, len(handles)),
                frameon=False,
            )
        save(figure, out)
    return WrittenFigure(out, tuple(panels), left_out)


def panels_of(path: Path, what: str, choice: PlotSelection, among_all: bool) -> Iterator[tuple[str, Panel]]:
    """The panels of one plot: (name, function that draws it)."""
    options: dict[str, Any] = {"replicate": choice.replicate, "target": choice.target}
    if what == "states":
        plan = plot_data.layout(path)
        shown_by_track = among_all and tuple(plan.units) == plan.position  # the only column, over time
        for column in (choice.column,) if choice.column is not None else () if shown_by_track else plan.units:
            yield f"state {column}", partial(plots.states, path=path, column=column, **options)
        return
    if what == "particles":
        last = plot_data.last_step_with_particles(path, **options) if choice.step is None else choice.step
        options |= {"step": last, "column": choice.column}
    elif what == "step":
        options["step"] = choice.step
    elif what != "track":
        options = {"plugins": choice.plugins} if what in ("error", "gospa") else {}
    yield what, partial(getattr(plots, what), path=path, **options)
