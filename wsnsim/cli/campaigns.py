"""The commands of campaigns: sweep, compare, collect."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.shared import INCOMPLETE, METRIC, PATH, echo_lines, file_name, group, is_campaign

MAX_NAMED_SCENARIOS: Final = 5
"""Number of scenarios that the default name of a comparison contains."""


_session_options = shared.with_options(
    shared.overrides_option,
    click.option("--replicates", type=click.IntRange(min=1), metavar="N", help="Monte Carlo runs per point."),
    shared.seed_option,
    shared.timeout_option,
    click.option("--out", "-o", type=PATH, metavar="DIR", help="Folder of the campaign; default results/NAME."),
    shared.jobs_option,
    click.option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler: tcp://host:8786."),
    click.option("--scheduler-file", type=PATH, metavar="FILE", help="Read the scheduler's address from this file."),
    click.option("--shard", metavar="I/N", help="Run shard I of N; `wsnsim collect` merges the shards."),
    click.option(
        "--watch", "live", is_flag=True, help="Show the campaign in a browser while it computes, as `wsnsim watch`."
    ),
    click.option("--dry-run", is_flag=True, help="Only estimate the number of runs, the time and the size."),
    click.option("--metric", default=METRIC, show_default=True, metavar="NAME", help="Column of runs to compare."),
    click.option("--by", multiple=True, metavar="KEY", help="Key whose values are compared; others are fixed."),
    click.option("--baseline", metavar="VALUE", help="Value that others are compared with; default the first."),
    click.option("--csv", type=PATH, metavar="FILE", help="Also write all values of the table to this file."),
    click.option("--latex", type=PATH, metavar="FILE", help="Also write the table to this file, as LaTeX."),
    click.option("--explain", is_flag=True, help="Also say what the columns mean."),
    click.option(
        "--bound/--no-bound",
        default=None,
        help="Show the Cramer-Rao bound beside the errors; default only in compare.",
    ),
    shared.accept_code_option,
    shared.plugins_option,
    shared.batch_option,
    shared.json_option,
    shared.quiet_option,
    shared.progress_option,
)
"""The options that sweep and compare share."""


@group.command()
@click.argument("source", metavar="SWEEP|SCENARIO|DIR")
@click.option(
    "--vary", multiple=True, metavar="KEY=VALUES", help="A key and its values, an axis: tracker.particles=100,200."
)
@_session_options
@click.pass_obj
def sweep(interrupts: Interrupts, /, source: str, vary: tuple[str, ...], **given: Any) -> int:
    """Run a scenario at many points of its parameters.

    Each point has several Monte Carlo runs. SWEEP is a file with a scenario, axes and the number of runs (`wsnsim list
    sweeps`). A SCENARIO needs axes from --vary. DIR is the folder of a campaign, which is resumed.
    """
    from wsnsim.cli import campaign_session as session

    options, overrides, changes = session.options_of(given)
    if is_campaign(source):
        return session.resume(source, options, interrupts, (*vary, *overrides, *changes.values()))
    from wsnsim.scenario.sweep import is_sweep, load_sweep
    from wsnsim.scenario.texts import find_or_none, shipped_sweeps

    if not is_sweep(source):
        if not vary:
            if find_or_none(source) is not None:
                shared.loaded(source, overrides, options.plugins)
                raise UsageError(f"{source} is a scenario: give the axes to vary with --vary KEY=VALUES")
            nearest = did_you_mean(source, shipped_sweeps())
            raise UsageError(f"unknown sweep, scenario or campaign '{source}' ({nearest})")
        keys = "_".join(axis.partition("=")[0].strip().rpartition(".")[2] for axis in vary)
        changes["name"] = file_name(f"{Path(source).stem}_by_{keys}")
    return session.run_plan(load_sweep(source, vary, overrides, **changes), options, interrupts, options.by)


@group.command()
@click.argument("sources", metavar="SCENARIO...|DIR", nargs=-1, required=True)
@click.option(
    "--trackers", metavar="A,B,...", help="Run the scenario with each of these trackers: 'pf:particles=1000,ekf'."
)
@click.option(
    "--vary", multiple=True, metavar="KEY=VALUES", help="Also vary a key of the scenario: deploy.nodes=100,200."
)
@_session_options
@click.pass_obj
def compare(
    interrupts: Interrupts, /, sources: tuple[str, ...], trackers: str | None, vary: tuple[str, ...], **given: Any
) -> int:
    """Compare trackers or scenarios on the same targets and noise.

    In each Monte Carlo run all of them get the same ground truth, network and measurements. DIR is the folder of a
    campaign that exists.
    """
    from wsnsim.cli import campaign_session as session

    # without --no-bound, a comparison shows the bounds
    options, overrides, changes = session.options_of({**given, "bound": given["bound"] is not False})
    if len(sources) == 1 and is_campaign(sources[0]):
        return session.resume(sources[0], options, interrupts, (trackers, *vary, *overrides, *changes.values()))
    from wsnsim.scenario.sweep import load_sweep
    from wsnsim.scenario.texts import find_or_none

    shared.demand_no_trackers("compare", sources, trackers)
    if len(sources) == 1 and not trackers and find_or_none(sources[0]):
        shared.loaded(sources[0], overrides, options.plugins)
        raise UsageError("give --trackers pso_mhpf,ipf,ppf, several scenarios, or a folder that holds a campaign")
    name = file_name("_".join(["compare", *(Path(source).stem for source in sources[:MAX_NAMED_SCENARIOS])]))
    plan = load_sweep(list(sources), vary, overrides, trackers, **changes, name=name)
    # trackers with parameters are swept as whole blocks, those without by their kind
    chosen = ("scenario", *(("tracker", "tracker.kind") if trackers else ()))
    return session.run_plan(plan, options, interrupts, options.by or tuple(key for key in chosen if key in plan.keys))


@group.command()
@click.argument("shards", metavar="DIR...", nargs=-1, required=True, type=PATH)
@click.option("--out", "-o", type=PATH, metavar="DIR", help="Folder of the merged campaign; default the first DIR.")
@click.option("--metric", default=METRIC, show_default=True, metavar="NAME", help="Column of runs to compare.")
@shared.accept_code_option
@shared.json_option
def collect(shards: tuple[Path, ...], out: Path | None, metric: str, accept_code_change: bool, as_json: bool) -> int:
    """Merge the shards of a campaign and list the missing runs."""
    import wsnsim.campaign as campaign
    from wsnsim.cli import campaign_session as session
    from wsnsim.recording.folder import Folder

    into = Folder(out or shards[0])
    manifest = campaign.collect([Folder(shard) for shard in shards], into, accept_code_change)
    missing = campaign.missing(into)
    options = session.Options(
        metric=metric, by=(), baseline=None, csv=None, latex=None, explain=False, as_json=as_json, bound=False
    )
    code = session.print_comparison(into, options)
    if missing:
        echo_lines([f"wsnsim: {into.path} is incomplete:", *campaign.describe_missing(missing, manifest)])
    return INCOMPLETE if missing else code
