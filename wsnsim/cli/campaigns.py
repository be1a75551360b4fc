"""The commands of campaigns: sweep, compare, collect, export."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import MODES
from wsnsim.cli.session import INCOMPLETE, METRIC, Choices, Said, answer, carried_out, gone_on_with, say
from wsnsim.cli.shared import group, is_campaign, json_option, overrides_option

FEW: Final = 5


def _shared(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that sweep and compare share."""
    path = click.Path(path_type=Path)
    options = [
        overrides_option,
        click.option("--replicates", type=click.IntRange(min=1), metavar="N", help="Runs a point."),
        click.option("--seed", type=click.IntRange(min=0), metavar="S", help="Seed of every random stream."),
        click.option("--timeout", metavar="TIME", help="Give a replicate up after that long: '10 min'."),
        click.option("--out", "-o", type=path, metavar="DIR", help="Folder of results; default results/NAME."),
        click.option(
            "--jobs", "-j", type=click.IntRange(1, 1024), metavar="N", help="Worker processes; default all cores."
        ),
        click.option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler: tcp://host:8786."),
        click.option("--scheduler-file", type=path, metavar="FILE", help="The same, by the file that it writes."),
        click.option("--shard", metavar="I/N", help="Run the I-th of N parts; `wsnsim collect` brings them together."),
        click.option(
            "--dry-run", is_flag=True, help="Say what would be run, how long it would take, and how large it is."
        ),
        click.option("--metric", default=METRIC, show_default=True, metavar="NAME", help="Column of runs to compare."),
        click.option(
            "--by", multiple=True, metavar="KEY", help="Compare by this key, within each value of the others."
        ),
        click.option("--baseline", metavar="VALUE", help="Differences are from this one; default the first."),
        click.option("--csv", type=path, metavar="FILE", help="Write the table to a file, too."),
        click.option(
            "--bound/--no-bound", default=None, help="The bound beside the errors; compare shows it by default."
        ),
        json_option,
        click.option("--quiet", "-q", is_flag=True, help="No progress and no log."),
        click.option("--progress", type=click.Choice(MODES), default="auto", show_default=True, help="How to show it."),
    ]
    for option in reversed(options):
        command = option(command)
    return command


@group.command()
@click.argument("source", metavar="SWEEP|SCENARIO|DIR")
@click.option("--vary", multiple=True, metavar="KEY=VALUES", help="An axis: tracker.particles=100,200,400.")
@_shared
@click.pass_obj
def sweep(
    interrupts: Interrupts,
    source: str,
    vary: tuple[str, ...],
    overrides: tuple[str, ...],
    replicates: int | None,
    seed: int | None,
    timeout: str | None,
    **choices: Any,
) -> int:
    """Run a scenario over axes of its parameters, many replicates a point.

    SWEEP is a file that names scenario, axes and replicates (`wsnsim list sweeps`); a SCENARIO takes its axes from
    --vary; DIR is the folder of a campaign, which is gone on with.
    """
    chosen = _choices(choices)
    if is_campaign(source):
        if vary or overrides or replicates or seed is not None or chosen.out or timeout:
            raise UsageError(
                f"{source} is a campaign, which says itself what is to be run: give the sweep to change it"
            )
        return gone_on_with(source, chosen, interrupts)
    from wsnsim.scenario.sweep import is_sweep, load_sweep

    given = {"replicates": replicates, "timeout": timeout}
    if not is_sweep(source):
        if not vary:
            raise UsageError(_no_sweep(source))
        given["name"] = _named(source, vary)
    plan = load_sweep(source, vary, _seeded(overrides, seed), **given)
    return carried_out(plan, chosen, interrupts, chosen.said.by)


@group.command()
@click.argument("sources", metavar="SCENARIO...|DIR", nargs=-1, required=True)
@click.option("--trackers", metavar="A,B,...", help="Put each of these in place of the scenario's tracker.")
@click.option("--vary", multiple=True, metavar="KEY=VALUES", help="Compare at each of these values.")
@_shared
@click.pass_obj
def compare(
    interrupts: Interrupts,
    sources: tuple[str, ...],
    trackers: str | None,
    vary: tuple[str, ...],
    overrides: tuple[str, ...],
    replicates: int | None,
    seed: int | None,
    timeout: str | None,
    **choices: Any,
) -> int:
    """Compare trackers, or scenarios, replicate by replicate on the same truth and the same readings."""
    chosen = _choices({**choices, "bound": choices["bound"] is not False})
    if len(sources) == 1 and is_campaign(sources[0]):
        if trackers or vary or overrides or replicates or seed is not None or timeout:
            raise UsageError(f"{sources[0]} is a campaign, which says itself what is compared")
        return gone_on_with(sources[0], chosen, interrupts)
    from wsnsim.scenario.sweep import load_sweep

    if len(sources) == 1 and not trackers:
        raise UsageError("give trackers to compare (--trackers pso_mhpf,ipf,ppf), or several scenarios")
    axes = ([f"tracker.kind={trackers}"] if trackers else []) + list(vary)
    name = _safe("_".join(["compare", *(Path(source).stem for source in sources[:FEW])]))
    given = {"replicates": replicates, "timeout": timeout, "name": name}
    plan = load_sweep(list(sources), axes, _seeded(overrides, seed), **given)
    by = [*(["scenario"] if len(sources) > 1 else []), *(["tracker.kind"] if trackers else [])]
    return carried_out(plan, chosen, interrupts, chosen.said.by or tuple(by))


@group.command()
@click.argument("parts", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", "-o", type=click.Path(path_type=Path), metavar="DIR", help="Where; default the first.")
@click.option("--metric", default=METRIC, show_default=True, metavar="NAME", help="Column of runs to show.")
@json_option
def collect(parts: tuple[Path, ...], out: Path | None, metric: str, as_json: bool) -> int:
    """Bring the parts of a campaign together, and say what is missing."""
    import wsnsim.campaign as campaign
    from wsnsim.recording.folder import Folder

    into = Folder(out or parts[0])
    manifest = campaign.collect([Folder(part) for part in parts], into)
    missing = campaign.missing(into)
    code = answer(into, Said(metric, (), None, None, as_json, bound=False))
    if missing:
        say([f"wsnsim: {into.path} is incomplete:", *campaign.missing_words(missing, manifest)])
    return INCOMPLETE if missing else code


@group.command()
@click.argument("result", metavar="FILE|DIR", type=click.Path(path_type=Path))
@click.option("--parquet", "place", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Where to.")
@click.option("--table", "tables", multiple=True, metavar="NAME", help="Only this table; default all that there are.")
def export(result: Path, place: Path, tables: tuple[str, ...]) -> None:
    """Write the tables of a result, or of a campaign, as Parquet files."""
    from wsnsim.analysis import parquet

    for file, rows in parquet.export(result, place, tables):
        click.echo(f"{file}: {rows:,} rows")


def _no_sweep(source: str) -> str:
    from wsnsim.scenario.files import find_or_none, shipped_sweeps

    if Path(source).is_dir():
        return f"{source} is a folder, and holds no campaign"
    if find_or_none(source) is not None:
        return f"{source} is a scenario: say with --vary KEY=VALUES over which axes to run it"
    return f"there is no sweep, scenario or campaign '{source}' ({did_you_mean(source, shipped_sweeps())})"


def _choices(given: Mapping[str, Any]) -> Choices:
    said = Said(**{name: given[name] for name in Said._fields})
    return Choices(said=said, **{name: value for name, value in given.items() if name not in Said._fields})


def _seeded(overrides: tuple[str, ...], seed: int | None) -> tuple[str, ...]:
    return overrides if seed is None else (*overrides, f"seed={seed}")


def _named(source: str, vary: Sequence[str]) -> str:
    """What a campaign is called whose axes come from the command line: pso_mhpf_by_particles."""
    keys = "_".join(axis.partition("=")[0].strip().rpartition(".")[2] for axis in vary)
    return _safe(f"{Path(source).stem}_by_{keys}")


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "_-." else "_" for c in name)[:100]
