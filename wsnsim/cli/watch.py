"""The command that shows a run, a campaign or a result in a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.live import LiveOptions, live_options, page_of, say_where, show_page, stay
from wsnsim.cli.running import RunOptions, run_options, run_scenario
from wsnsim.cli.shared import echo, group, is_campaign, reading

OF_CAMPAIGNS = ("port", "browser", "ends", "metric", "column", "quiet", "source", "out")
"""Options that also have a meaning for a campaign."""
OF_RESULTS = ("port", "browser", "bounds", "plugins", "quiet", "source", "ends", "metric", "column")
"""Options that also have a meaning for a result, or are refused with a reason of their own."""


@group.command()
@click.argument("source", metavar="SCENARIO|SWEEP|DIR|FILE.h5")
@live_options
@click.option("--metric", metavar="NAME", help="Of a campaign: the column of runs to plot; default rmse.")
@click.option("--column", metavar="KEY", help="Of a campaign: the swept key on the axis.")
@run_options
@click.pass_context
def watch(
    context: click.Context, /, source: str, port: int, browser: bool, ends: bool, metric: str | None,
    column: str | None, **given: Any,
) -> int | None:  # fmt: skip
    """Show a run, a campaign or a result in a browser.

    The page is served to this machine only. It shows a run while it computes, and then its result, until Ctrl-C.
    A campaign is one that another process runs, or has run: DIR is its folder. The folder of a SWEEP is results/NAME,
    or that of --out. FILE.h5 is a result, whose page is shown.
    """
    live, interrupts = LiveOptions(port, browser, ends), context.obj
    if _is_finished_result(source):
        _refuse_options_of_runs(context, OF_RESULTS, f"a result; to run its scenario: wsnsim run {source} --watch")
        _demand_campaign(metric, column)
        _show_result(Path(source), live, interrupts, given)
        return None
    folder = _folder(source, given["out"])
    if folder is None:
        _demand_campaign(metric, column)
        run_scenario(source, RunOptions(**given), interrupts, live)
        return None
    _refuse_options_of_runs(context, OF_CAMPAIGNS, "a campaign, which another process runs")
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


def _is_finished_result(source: str) -> bool:
    """Whether the source is a result, and no campaign's folder."""
    from wsnsim.scenario.files import is_result

    return not Path(source).is_dir() and is_result(source)


def _demand_campaign(metric: str | None, column: str | None) -> None:
    if metric or column:
        raise UsageError("--metric and --column need a campaign")


def _show_result(result: Path, live: LiveOptions, interrupts: Interrupts, given: dict[str, Any]) -> None:
    """Serve the page of a result until Ctrl-C.

    Raises:
        UsageError: the command would end at once.
        ResultError: the file cannot be read.
    """
    import wsnsim.recording as recording

    recording.attributes(result)
    if live.ends:
        raise UsageError(f"--exit: {result} is a result, whose run has ended; wsnsim report {result} writes its page")
    with reading(result):
        page = page_of(result, None, given["plugins"], given["bounds"])
    show_page(page, live, given["quiet"], interrupts)


def _refuse_options_of_runs(context: click.Context, allowed: Sequence[str], what: str) -> None:
    """Raise UsageError if an option was given that has no meaning for what is shown."""
    for parameter in context.command.params:
        name = parameter.name or ""
        given = context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
        if given and name not in allowed:
            raise UsageError(f"{parameter.opts[0]} has no meaning for {what}")


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
