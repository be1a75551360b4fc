"""The style of all figures, the bands around curves, and how a figure is written to a file.

write_figure(draw, out, size) -> out      a figure that draw(figure) puts axes on
figure_of(panels) -> Figure               a figure with a panel for each of these functions of Axes
save(figure, out)                         writes a figure so that the same figure gives the same bytes
band(axes, x, rows, label, ...)           median over runs with the band between quartiles(rows)
rmse_band(axes, x, rows, label, ...)      RMSE over runs with its 95 % confidence band
rmse_interval(rows) -> (low, high)        this confidence band
titled(axes, title, of_time)              a title, and the legend between it and the data
legend_above(axes, size) -> float         this legend alone; its height
runs_text(runs, whose) -> str             the number of runs, for a title
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.recording.atomic_files import replacing

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
"""Colours of Okabe and Ito (2008), which colour-blind readers can distinguish."""
GREY, PALE = "#8C8C8C", "#D0D0D0"
COLOURS: Final = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
"""The colours of curves, in this order."""
PUBLISHED: Final[dict[str, Any]] = {"color": "#666666", "linestyle": "--", "linewidth": 1.0}
"""The line of a published value."""
BOUND: Final[dict[str, Any]] = {"color": BLACK, "linestyle": ":", "linewidth": 1.2}
"""The line of a bound."""
LEGEND: Final[dict[str, Any]] = {
    "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.1, "borderpad": 0.2,
    "handlelength": 1.4, "columnspacing": 1.0,
}  # fmt: skip
"""A legend between the title and the data."""
CHARACTERS: Final = 160.0
"""Characters of a legend in an inch, times the size of a letter in points."""
MIN_RUNS: Final = 5
"""The smallest number of runs that have a band, as for `metrics.bootstrap_interval`."""
RESAMPLES: Final = 400
"""Resamples of a bootstrap."""


# Metadata without a date, by file suffix, so that the same figure gives the same bytes.
UNDATED: Final[dict[str, dict[str, Any]]] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
GIF: Final = ".gif"
"""The suffix of an animation."""
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
Panel = Callable[[Axes], Axes]
"""A function that draws one panel of a figure."""


def write_figure(draw: Callable[[Figure], None], out: Path, size: tuple[float, float], title: str = "") -> Path:
    """Write the figure that `draw` fills. Raises ResultError if it cannot be written."""
    with style.context(["default", STYLE]):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)  # figures of studies measure their texts
        draw(figure)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        save(figure, out)
    return out


WIDTHS: Final = {"column": 3.5, "text": 7.16}
"""Widths of figures in a paper (inches): a column and the whole text of two columns, as in IEEE journals."""
PAPER_LEGEND: Final = 7.0
"""Size of the letters of a legend in a paper (points)."""


def figure_of(panels: list[Panel], width: float | None = None) -> Figure:
    """A figure with these panels in one or two columns; with a `width` (inches), for a paper, which has captions."""
    across = min(len(panels), 2 if width is None or width > WIDTHS["column"] else 1)
    down = ceil(len(panels) / across)
    size = (5.4 * across, 3.6 * down) if across > 1 else (6.4, 4.6)
    if width is not None:
        size = (width, width / across * 0.72 * down)
    figure = Figure(figsize=size, layout="constrained")
    cells = figure.subplots(down, across, squeeze=False).ravel()
    for cell, panel in zip(cells, panels, strict=False):
        panel(cell)
        if width is not None:
            cell.set_title("", loc="left")
            if cell.get_legend():
                legend_above(cell, PAPER_LEGEND)
    for cell in cells[len(panels) :]:
        cell.remove()
    return figure


def save(figure: Figure, out: Path) -> None:
    """Write a figure. The file gets its name only when it is complete."""
    suffix = suffix_of(out)
    with replacing(out) as unfinished:
        figure.savefig(unfinished, format=suffix[1:], metadata=UNDATED[suffix])


def suffix_of(out: Path, animated: bool = False) -> str:
    """The suffix of a figure in lower case. Raises UsageError if that format cannot be written.

    `animated` says whether it may be a GIF, which shows the steps of a run.
    """
    suffix, known = out.suffix.lower(), (*UNDATED, GIF) if animated else tuple(UNDATED)
    if suffix == GIF and not animated:
        raise UsageError(f"{out}: only the steps of a run can be a GIF: wsnsim plot --what step, without --step")
    if suffix not in known:
        hint = did_you_mean(suffix, known) if suffix else "known: " + ", ".join(known)
        raise UsageError(f"{out}: a figure cannot have the suffix '{suffix}' ({hint})")
    return suffix


def band(axes: Axes, x: Floats, rows: Floats, label: str, colour: str) -> Axes:
    """Draw the median over the rows (runs, len(x)) and the band between their quartiles; the label counts the runs."""
    low, middle, high = quartiles(rows)
    runs = f"{len(rows)} runs" if len(rows) > 1 else "one run"
    axes.plot(x, middle, color=colour, linewidth=1.2, label=f"{label} (median and quartiles of {runs})")
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
    return axes


def quartiles(rows: Floats) -> Floats:
    """(3, steps) the quartiles over the rows (runs, steps); NaN at steps without an estimate."""
    known = np.isfinite(rows).any(axis=0)
    result = np.full((3, rows.shape[1]), np.nan)
    if known.any():
        result[:, known] = np.nanquantile(rows[:, known], [0.25, 0.5, 0.75], axis=0)
    return result


def rmse_band(
    axes: Axes, x: Floats, rows: Floats, label: str, colour: str, width: float = 1.4, banded: bool = True
) -> Axes:
    """Draw the RMSE over the rows (runs, len(x)) and, if `banded`, its 95 % confidence band.

    The lower limit of the axes follows the curves, not the bands, which reach far down on a logarithmic scale.
    """
    axes.plot(x, metrics.per_step_rmse(rows), color=colour, linewidth=width, label=label)
    if not banded:
        return axes
    low, high = rmse_interval(rows)
    known = np.isfinite(high)
    if known.any():
        limits = axes.dataLim.frozen()
        axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.dataLim.set(limits)
        axes.update_datalim(np.column_stack([x, high])[known])
    return axes


def rmse_interval(rows: Floats, resamples: int = RESAMPLES) -> tuple[Floats, Floats]:
    """The 95 % percentile-bootstrap interval of the RMSE over the rows (runs, steps) at each step, as (low, high).

    It is NaN at a step at which fewer than five runs have an estimate. Whole runs are resampled, with a seed that
    depends on their number only. A resample without any estimate at a step does not count there.
    """
    count, known = len(rows), np.isfinite(rows)
    low, high = np.full((2, rows.shape[1]), np.nan)
    enough = known.sum(axis=0) >= MIN_RUNS
    if not enough.any():
        return low, high
    square = np.where(known, rows, 0.0)[:, enough] ** 2
    rng = np.random.Generator(np.random.Philox(count))
    weights = rng.multinomial(count, np.full(count, 1.0 / count), size=resamples).astype(np.float64)
    with np.errstate(invalid="ignore"):
        resampled = np.sqrt(weights @ square / (weights @ known[:, enough]))
    low[enough], high[enough] = np.nanquantile(resampled, [0.025, 0.975], axis=0)
    return low, high


def runs_text(runs: int, whose: str = "") -> str:
    """The number of runs, for a title; from MIN_RUNS on also the meaning of the bands, and of whose RMSE they are."""
    if runs < MIN_RUNS:
        return f"{runs} runs" if runs > 1 else "one run"
    return f"{runs} runs (bands{f' of {whose}' if whose else ''}: 95 % confidence)"


def titled(axes: Axes, title: str, of_time: str = "") -> Axes:
    """Set the title, and between it and the data the legend; labels of what is drawn over time.

    Args:
        axes: matplotlib axes.
        title: the title.
        of_time: the label of the values; empty where they are not over time.
    """
    if of_time:
        axes.set_xlabel("time [s]")
        axes.set_ylabel(of_time)
    axes.set_title(title, loc="left", pad=8 + legend_above(axes))
    return axes


def legend_above(axes: Axes, size: float = 8.0) -> float:
    """Draw the legend above the data in letters of a size (points), in as few rows as fit; its height in points."""
    handles, labels = axes.get_legend_handles_labels()
    room = CHARACTERS / size * axes.bbox.width / axes.figure.dpi
    for across in range(len(labels), 0, -1):
        columns = [part.tolist() for part in np.array_split(labels, across)]
        if sum(6 + max(map(len, "\n".join(column).split("\n"))) for column in columns) <= room:
            break
    axes.legend(handles, labels, ncols=across, fontsize=size, labelspacing=0.2, **LEGEND)
    return 1.4 * size * max(1 + "\n".join(column).count("\n") for column in columns)
