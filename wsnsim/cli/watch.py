"""The command that shows a run or a campaign in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.live import LiveOptions, live_options, say_where, stay
from wsnsim.cli.running import RunOptions, run_options, run_scenario
from wsnsim.cli.shared import echo, group, is_campaign

OF_CAMPAIGNS = ("port", "browser", "ends", "metric", "column", "quiet")
"""Options that also have a meaning for a campaign."""


@group.command()
@click.argument("source", metavar="SCENARIO|SWEEP|DIR")
@live_options
@click.option("--metric", metavar="NAME", help="Of a campaign: the column of runs to plot; default rmse.")
@click.option("--column", metavar="KEY", help="Of a campaign: the swept key on the axis.")
@run_options
@click.pass_context
def watch(
    context: click.Context, /, source: str, port: int, browser: bool, ends: bool, metric: str | None,
    column: str | None, **given: Any,
) -> int | None:  # fmt: skip
    """Show a run or a campaign in a browser while it computes.

    The page is served to this machine only. After the run it shows the result, until Ctrl-C. A campaign is one that
    another process runs, or has run: DIR is its folder. The folder of a SWEEP is results/NAME, or that of --out.
    """
    live, interrupts = LiveOptions(port, browser, ends), context.obj
    folder = _folder(source, given["out"])
    if folder is None:
        if metric or column:
            raise UsageError("--metric and --column need a campaign")
        run_scenario(source, RunOptions(**given), interrupts, live)
        return None
    _refuse_options_of_runs(context)
    return _follow(folder, metric or "rmse", column, live, interrupts, given["quiet"])


def _folder(source: str, out: Path | None) -> Path | None:
    """The folder of the campaign to follow, None if the source is a scenario."""
    if is_campaign(source):
        return Path(source)
    from wsnsim.scenario.sweep import is_sweep, load_sweep

    if Path(source).is_dir():
        raise UsageError(f"folder holds no campaign: {source}")
    if not is_sweep(source):
        return None
    folder = out or Path("results") / load_sweep(source).name
    if not is_campaign(str(folder)):
        raise UsageError(f"{folder}: holds no campaign yet; start it in another terminal: wsnsim sweep {source}")
    return folder


def _refuse_options_of_runs(context: click.Context) -> None:
    """Raise UsageError if an option was given that only a run has."""
    for parameter in context.command.params:
        name = parameter.name or ""
        given = context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
        if given and name not in (*OF_CAMPAIGNS, "source", "out"):
            raise UsageError(f"{parameter.opts[0]} has no meaning for a campaign, which another process runs")


def _follow(
    folder: Path, metric: str, column: str | None, live: LiveOptions, interrupts: Interrupts, quiet: bool
) -> int:
    from wsnsim.recording.folder import Folder
    from wsnsim.watch.campaign_view import CampaignView

    with CampaignView(Folder(folder), metric, column, live.port) as view:
        say_where(view.url, live)
        stay(interrupts, lambda: view.follow(until_complete=live.ends))
        if not quiet:
            echo(f"wsnsim: {folder}: {view.state()}", err=True)
    return 0
