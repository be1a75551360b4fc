"""The command that plots results and campaigns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.shared import PATH, echo, group, not_the_result, plugins_option, reading, writable

if TYPE_CHECKING:
    from wsnsim.analysis.figures import WrittenFigure

PLOTS: Final = ("all", "track", "states", "error", "consistency", "energy", "particles")


@group.command()
@click.argument("result", metavar="FILE|DIR", type=PATH)
@click.option("--what", type=click.Choice(PLOTS), default="all", show_default=True, help="What to plot.")
@click.option("--column", metavar="NAME", help="State column of states or particles; for a campaign, the swept key.")
@click.option("--metric", metavar="NAME", help="For a campaign: the column of runs to plot; default rmse.")
@click.option("--step", type=click.IntRange(min=0), metavar="K", help="Step of the particles; default the last.")
@click.option("--replicate", type=click.IntRange(min=0), metavar="R", help="Run to plot; default 0.")
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target to plot; default 0.")
@click.option(
    "--out", "-o", type=PATH, metavar="PLOT", help="A .png, .svg or .pdf file; default FILE.png or DIR/figures.png."
)
@plugins_option
def plot(
    result: Path,
    what: str,
    column: str | None,
    metric: str | None,
    step: int | None,
    replicate: int | None,
    target: int | None,
    out: Path | None,
    plugins: bool,
) -> None:
    """Plot a result, or a campaign over one of its swept keys."""
    import wsnsim.recording as recording
    from wsnsim.analysis import figures
    from wsnsim.analysis.figure_style import suffix_of
    from wsnsim.recording.folder import Folder

    if result.is_dir():
        if what != "all" or any(value is not None for value in (step, replicate, target)):
            raise UsageError(f"{result} is a folder: a campaign takes only --column, --metric and --out")
        folder = Folder(result)
        folder.manifest()
        path = _plot_path(out or result / "figures.png")
        _print_plotted(figures.draw_campaign(folder, path, metric or "rmse", column))
        return
    if metric is not None:
        raise UsageError("--metric needs the folder of a campaign")
    for name, value in (("column", column), ("step", step), ("replicate", replicate), ("target", target)):
        if value is not None and name not in figures.TAKES[what]:
            takes = ", ".join(other for other, names in figures.TAKES.items() if name in names)
            raise UsageError(f"--{name} cannot be combined with --what {what}; it can with {takes}")
    plot_file = out or result.with_suffix(".png")
    suffix_of(plot_file)
    recording.attributes(result)
    path = not_the_result(_plot_path(plot_file), result, "plot")
    chosen = figures.PlotSelection(column, step, replicate or 0, target or 0, plugins)
    with reading(result):
        drawn = figures.draw(result, path, what, chosen)
    _print_plotted(drawn)


def _plot_path(path: Path) -> Path:
    """The path, checked for its suffix and for being writable."""
    from wsnsim.analysis.figure_style import suffix_of

    suffix_of(path)
    return writable(path, Path(path.name))


def _print_plotted(plotted: WrittenFigure) -> None:
    echo(f"{plotted.out}: {', '.join(plotted.shown)}")
    for name, reason in plotted.left_out.items():
        echo(f"  without {name}: {reason}")
