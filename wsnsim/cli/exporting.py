"""The commands that write results for others: tables for other tools, figures, and an HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli import shared
from wsnsim.cli.shared import PATH, echo, group, not_the_result, plot_path, reading, writable

if TYPE_CHECKING:
    from wsnsim.analysis.figures import WrittenFigure


@group.command()
@click.argument("result", metavar="FILE|DIR", type=PATH)
@click.option("--csv", "csv_folder", type=PATH, metavar="DIR", help="Write a CSV file per table into this folder.")
@click.option(
    "--parquet", "parquet_folder", type=PATH, metavar="DIR", help="Write a Parquet file per table into this folder."
)
@click.option("--mat", "matlab_file", type=PATH, metavar="FILE.mat", help="Write one MATLAB file, a struct per table.")
@click.option("--table", "tables", multiple=True, metavar="NAME", help="Export only this table; default all.")
def export(
    result: Path,
    csv_folder: Path | None,
    parquet_folder: Path | None,
    matlab_file: Path | None,
    tables: tuple[str, ...],
) -> None:
    """Export tables as CSV, Parquet or MATLAB files.

    FILE is a result, DIR the folder of a campaign.
    """
    if csv_folder is None and parquet_folder is None and matlab_file is None:
        raise UsageError("say what to write: --csv DIR, --parquet DIR or --mat FILE.mat")
    if matlab_file is not None:
        if matlab_file.suffix != ".mat":
            raise UsageError(f"--mat {matlab_file}: the name of a MATLAB file ends in .mat")
        writable(matlab_file, matlab_file, "--mat")
        if result.exists():
            not_the_result(matlab_file, result, "MATLAB file")
    with reading(result):
        from wsnsim.analysis import frames

        for folder, write in ((csv_folder, frames.csv), (parquet_folder, frames.parquet)):
            if folder is not None:
                for file, rows in write(result, folder, tables):
                    echo(f"{file}: {rows:,} rows")
        if matlab_file is not None:
            for table, rows in frames.matlab(result, matlab_file, tables):
                echo(f"{matlab_file}: {table}: {rows:,} rows")


PLOTS: Final = ("all", "track", "states", "gospa", "error", "consistency", "energy", "particles", "step")


@group.command()
@click.argument("result", metavar="FILE|DIR", type=PATH)
@click.option("--what", type=click.Choice(PLOTS), default="all", show_default=True, help="What to plot.")
@click.option("--column", metavar="NAME", help="State column of states or particles; for a campaign, the swept key.")
@click.option("--metric", metavar="NAME", help="For a campaign: the column of runs to plot; default rmse.")
@click.option("--step", type=click.IntRange(min=0), metavar="K", help="Step of particles (default the last) or step.")
@click.option("--replicate", type=click.IntRange(min=0), metavar="R", help="Run to plot; default 0.")
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target to plot; default 0.")
@click.option(
    "--out", "-o", type=PATH, metavar="PLOT",
    help="A .png, .svg or .pdf file, .gif for the steps of a run; default FILE.png or DIR/figures.png.",
)  # fmt: skip
@click.option("--width", type=click.Choice(("column", "text")), help="Width of a figure for a paper, without titles.")
@shared.plugins_option
def plot(
    result: Path, what: str, metric: str | None, out: Path | None, width: str | None, plugins: bool, **chosen: Any
) -> None:
    """Plot a result, or a campaign over one of its swept keys.

    `--what step` draws nodes, target and estimate at a step, by default that of the largest error; as a GIF, all steps.
    """
    import wsnsim.recording as recording
    from wsnsim.analysis import figures
    from wsnsim.analysis.figure_style import WIDTHS
    from wsnsim.recording.folder import Folder

    inches = None if width is None else WIDTHS[width]
    if result.is_dir():
        if what != "all" or any(chosen[name] is not None for name in ("step", "replicate", "target")):
            raise UsageError(f"{result} is a folder: a campaign takes only --column, --metric and --out")
        folder = Folder(result)
        folder.manifest()
        path = plot_path(out or result / "figures.png")
        _print_plotted(figures.draw_campaign(folder, path, metric or "rmse", chosen["column"], inches))
        return
    if metric is not None:
        raise UsageError("--metric needs the folder of a campaign")
    for name in figures.TAKES["all"]:
        if chosen[name] is not None and name not in figures.TAKES[what]:
            takes = ", ".join(other for other, names in figures.TAKES.items() if name in names)
            raise UsageError(f"--{name} cannot be combined with --what {what}; it can with {takes}")
    plot_file = out or result.with_suffix(".png")
    animated = what == "step" and chosen["step"] is None
    path = plot_path(plot_file, animated)
    recording.attributes(result)
    not_the_result(path, result, "plot")
    given = {name: value for name, value in chosen.items() if value is not None}
    with reading(result):
        drawn = figures.draw(result, path, what, figures.PlotSelection(**given, plugins=plugins, width=inches))
    _print_plotted(drawn)


def _print_plotted(plotted: WrittenFigure) -> None:
    echo(f"{plotted.out}: {', '.join(plotted.shown)}")
    for name, reason in plotted.left_out.items():
        echo(f"  without {name}: {reason}")


@group.command()
@click.argument("results", metavar="FILE...", nargs=-1, required=True, type=PATH)
@click.option(
    "--out", "-o", type=PATH, metavar="PAGE.html", help="Page; default FILE.html, or report.html for several files."
)
@click.option("--replicate", type=click.IntRange(min=0), metavar="R", help="Run to replay; default the first.")
@click.option(
    "--megabytes",
    type=click.FloatRange(min=0.1),
    default=2.0,
    show_default=True,
    metavar="MB",
    help="Largest size of the page; replay and figures are reduced to fit.",
)
@shared.bounds_option
@shared.plugins_option
def report(results: tuple[Path, ...], out: Path | None, megabytes: float, **options: Any) -> None:
    """Write one HTML page of results, with a replay.

    The page needs no other file and loads nothing from the Internet.
    """
    import wsnsim.recording as recording
    import wsnsim.report as pages
    from wsnsim.papers import published

    for result in results:
        recording.attributes(result)
    page = out or (results[0].with_suffix(".html") if len(results) == 1 else Path("report.html"))
    path = writable(page, Path("report.html"))
    for result in results:
        not_the_result(path, result, "page")
    with reading(*results):
        written = pages.write(results, path, limit=int(1e6 * megabytes), published=published, **options)
    echo(f"{written.path}: {written.size / 1e6:.2f} MB; open it in a browser")
    for note in written.notes:
        echo(f"  {note}")
