"""The command that writes a page of results."""

from __future__ import annotations

from pathlib import Path

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.shared import group, writable


@group.command()
@click.argument("results", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out",
    "-o",
    type=click.Path(path_type=Path),
    metavar="PAGE.html",
    help="Default FILE.html, of several report.html.",
)
@click.option("--replicate", type=click.IntRange(min=0), metavar="R", help="Run to replay; default the first.")
@click.option(
    "--megabytes",
    type=click.FloatRange(min=0.1),
    default=2.0,
    show_default=True,
    metavar="MB",
    help="Size to keep to; what does not fit is thinned.",
)
def report(results: tuple[Path, ...], out: Path | None, replicate: int | None, megabytes: float) -> None:
    """Write one HTML page of results, with a replay; it needs no network."""
    from wsnsim.papers.published import published
    from wsnsim.recording import attributes
    from wsnsim.report import html_page as reports

    for result in results:
        attributes(result)
    page = out or (results[0].with_suffix(".html") if len(results) == 1 else Path("report.html"))
    place = writable(page, Path(page.name))
    for result in results:
        if place.exists() and place.samefile(result):
            raise UsageError(f"{place} is the result itself; say with --out where the page goes")
    written = reports.write(results, place, replicate, int(1e6 * megabytes), published)
    click.echo(f"{written.out}: {written.bytes / 1e6:.2f} MB; open it in a browser")
    for note in written.notes:
        click.echo(f"  {note}")
