"""The command that draws results and campaigns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.shared import group, writable

if TYPE_CHECKING:
    from wsnsim.analysis.figures import WrittenFigure

PICTURES: Final = ("all", "track", "states", "error", "energy", "particles")


@group.command()
@click.argument("result", metavar="FILE|DIR", type=click.Path(path_type=Path))
@click.option("--what", type=click.Choice(PICTURES), default="all", show_default=True, help="What to draw.")
@click.option(
    "--column", metavar="NAME", help="State column, of the states or of the particles; of a campaign, the swept key."
)
@click.option("--metric", metavar="NAME", help="Of a campaign: the column of runs to draw; default rmse.")
@click.option("--step", type=click.IntRange(min=0), metavar="K", help="Step of the particles; default the last.")
@click.option("--replicate", type=click.IntRange(min=0), metavar="R", help="Run to draw; default 0.")
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target to draw; default 0.")
@click.option(
    "--out",
    "-o",
    type=click.Path(path_type=Path),
    metavar="PICTURE",
    help="A .png, .svg or .pdf; default FILE.png, or DIR/figures.png.",
)
def plot(
    result: Path,
    what: str,
    column: str | None,
    metric: str | None,
    step: int | None,
    replicate: int | None,
    target: int | None,
    out: Path | None,
) -> None:
    """Draw what a result shows, or a campaign over one of its keys, in one picture."""
    from wsnsim.analysis import figures
    from wsnsim.recording import attributes
    from wsnsim.recording.folder import Folder

    if result.is_dir():
        if what != "all" or any(value is not None for value in (step, replicate, target)):
            raise UsageError(f"{result} is a folder: of a campaign only --column, --metric and --out can be chosen")
        _tell_drawn(figures.draw_campaign(Folder(result), _picture(out, result), metric or "rmse", column))
        return
    if metric is not None:
        raise UsageError("--metric has a meaning for the folder of a campaign only")
    for name, value in (("column", column), ("step", step), ("replicate", replicate), ("target", target)):
        if value is not None and name not in figures.TAKES[what]:
            takes = ", ".join(other for other, names in figures.TAKES.items() if name in names)
            raise UsageError(f"--{name} has no meaning for --what {what}; it has for {takes}")
    picture = out or result.with_suffix(".png")
    figures.suffix_of(picture)
    attributes(result)
    place = writable(picture, Path(picture.name))
    if place.exists() and place.samefile(result):
        raise UsageError(f"{place} is the result itself; say with --out where the picture goes")
    _tell_drawn(figures.draw(result, place, what, figures.PlotSelection(column, step, replicate or 0, target or 0)))


def _picture(out: Path | None, folder: Path) -> Path:
    """Where the picture of a campaign goes, once its folder is known to hold one."""
    from wsnsim.analysis import figures
    from wsnsim.recording.folder import Folder

    Folder(folder).manifest()
    picture = out or folder / "figures.png"
    figures.suffix_of(picture)
    return writable(picture, Path(picture.name))


def _tell_drawn(drawn: WrittenFigure) -> None:
    click.echo(f"{drawn.out}: {', '.join(drawn.shown)}")
    for name, reason in drawn.left_out.items():
        click.echo(f"  without {name}: {reason}")
