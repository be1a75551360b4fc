"""The command that writes an HTML page of results."""

from __future__ import annotations

from pathlib import Path

import click

from wsnsim.cli.shared import PATH, echo, group, not_the_result, plugins_option, reading, writable


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
@click.option(
    "--bound",
    "bounds",
    is_flag=True,
    help="Show the Cramer-Rao bounds for the measurements in range, used and arrived.",
)
@plugins_option
def report(
    results: tuple[Path, ...],
    out: Path | None,
    replicate: int | None,
    megabytes: float,
    bounds: bool,
    plugins: bool,
) -> None:
    """Write one HTML page of results, with a replay.

    The page needs no other file and loads nothing from the Internet.
    """
    import wsnsim.recording as recording
    import wsnsim.report as pages
    from wsnsim.papers.published import published

    for result in results:
        recording.attributes(result)
    page = out or (results[0].with_suffix(".html") if len(results) == 1 else Path("report.html"))
    path = writable(page, Path(page.name))
    for result in results:
        not_the_result(path, result, "page")
    with reading(*results):
        written = pages.write(results, path, replicate, int(1e6 * megabytes), published, plugins, bounds)
    echo(f"{written.path}: {written.size / 1e6:.2f} MB; open it in a browser")
    for note in written.notes:
        echo(f"  {note}")
