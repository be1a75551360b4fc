"""The commands of scenarios and results: each reads its arguments, calls the room that does the work, and answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from wsnsim.base.errors import ResultError, ScenarioError, UsageError
from wsnsim.cli.progress import MODES, shown
from wsnsim.cli.shared import (
    command_line,
    echo_json,
    group,
    is_campaign,
    json_option,
    overrides_option,
    result_argument,
    writable,
)

if TYPE_CHECKING:
    from wsnsim.scenario.schema import Scenario

HDF5_MARK: Final = b"\x89HDF\r\n\x1a\n"


@group.command()
@click.argument("source", metavar="SCENARIO")
@overrides_option
@click.option("--replicates", type=click.IntRange(min=1), metavar="N", help="Runs with other draws, into one file.")
@click.option("--seed", type=click.IntRange(min=0), metavar="S", help="Seed of every random stream.")
@click.option(
    "--out", "-o", type=click.Path(path_type=Path), metavar="FILE.h5", help="Result; default results/NAME.h5."
)
@click.option("--report", "paged", is_flag=True, help="Write its page beside it, too: NAME.html.")
@json_option
@click.option("--quiet", "-q", is_flag=True, help="No progress and no log.")
@click.option("--progress", type=click.Choice(MODES), default="auto", show_default=True, help="How to show progress.")
def run(
    source: str,
    overrides: tuple[str, ...],
    replicates: int | None,
    seed: int | None,
    out: Path | None,
    paged: bool,
    as_json: bool,
    quiet: bool,
    progress: str,
) -> None:
    """Run a scenario and write its result."""
    seeded = overrides if seed is None else (*overrides, f"seed={seed}")
    scenario = _loaded(source, seeded)
    place = writable(out, Path("results") / f"{scenario.name}.h5")
    page = _page_beside(place) if paged else None
    import wsnsim.experiment as experiment
    from wsnsim.analysis import beaconing, summary, summary_text
    from wsnsim.papers.published import published
    from wsnsim.scenario import resolved

    show = shown("none" if quiet else progress)
    try:
        report = experiment.run(
            scenario,
            replicates=replicates,
            out=place,
            command_line=command_line(),
            progress=show.step if show else None,
        )
    finally:
        if show:
            show.close()
    printed, paper = published(resolved(scenario))
    if not report.states:
        told = beaconing.as_json(report) if as_json else beaconing.text(report)
    else:
        limit = summary.bounds_of_report(report)
        told = summary.as_json(report, printed, limit) if as_json else summary_text.text(report, printed, paper, limit)
    echo_json(told) if isinstance(told, dict) else click.echo(told)
    if page:
        from wsnsim.report import html_page as reports

        written = reports.write([place], page, published=published)
        if not quiet:
            click.echo(f"wsnsim: {written.out}: {written.bytes / 1e6:.2f} MB; open it in a browser", err=True)


def _page_beside(result: Path) -> Path:
    """Where the result's page goes. Raises UsageError, before anything runs, if it cannot go there."""
    page = result.with_suffix(".html")
    if page == result or (page.exists() and result.exists() and page.samefile(result)):
        raise UsageError(f"--report: the page of {result} would take its place; say --out {result.with_suffix('.h5')}")
    try:
        return writable(page, Path(page.name))
    except UsageError as error:
        raise UsageError(f"--report: {str(error).removeprefix('--out ')}") from None


@group.command()
@click.argument("sources", metavar="SCENARIO...", nargs=-1, required=True)
@overrides_option
def check(sources: tuple[str, ...], overrides: tuple[str, ...]) -> int:
    """Find every fault of scenarios, running none."""
    import wsnsim.scenario as scenario

    wrong = 0
    for source in sources:
        try:
            scenario.build(_loaded(source, overrides))
        except ScenarioError as error:
            wrong += 1
            click.echo(str(error), err=True)
        else:
            click.echo(f"{source}: ok")
    return 2 if wrong else 0


@group.command("list")
@click.argument("role", required=False)
@json_option
def list_(role: str | None, as_json: bool) -> None:
    """Show the kinds of every role, or of one: trackers, motions ...; or shipped scenarios, sweeps, or parts."""
    from wsnsim.cli import listing

    answer = listing.listed(role, as_json)
    if isinstance(answer, dict):
        echo_json(answer)
    else:
        click.echo(answer)


@group.command()
def schema() -> None:
    """Print the JSON Schema of scenarios, installed plug-ins included."""
    from wsnsim.scenario.json_schema import json_schema

    click.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@group.command()
@click.argument("name")
@click.option("--bench", is_flag=True, help="Without a network: a filter on its own.")
def new(name: str, bench: bool) -> None:
    """Write NAME.yaml, a commented scenario to start from."""
    from wsnsim.scenario.schema import is_safe_name
    from wsnsim.scenario.template import template

    stem = name.removesuffix(".yaml")
    if not is_safe_name(stem):
        raise UsageError(f"'{name}' cannot name a scenario: use letters and digits, then also '_', '-' and '.'")
    path = Path(f"{stem}.yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(template(stem, bench))
    except FileExistsError:
        raise UsageError(f"{path} exists already; it is left as it is") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    click.echo(f"{path}: a scenario to start from; run it with: wsnsim run {path}")


@group.command()
@click.argument("source", metavar="FILE|NAME")
@json_option
def info(source: str, as_json: bool) -> None:
    """Say what a result or a campaign's folder holds, a datasheet (`wsnsim list parts`), or a scenario's radio."""
    if is_campaign(source):
        from wsnsim.analysis import campaign_info

        told: Any = campaign_info.info(source) if as_json else campaign_info.info_text(source)
    elif source.endswith(".h5") or _is_result(source):
        from wsnsim.analysis import result_info

        told = result_info.info(Path(source)) if as_json else result_info.info_text(Path(source))
    else:
        from wsnsim.cli import profiles

        profile = profiles.profile(source)
        told = profile.as_json() if as_json else profile.text()
    if as_json:
        echo_json(told)
    else:
        click.echo(told)


@group.command()
@result_argument
@json_option
def verify(result: Path, as_json: bool) -> int:
    """Run a result's scenario again and compare the fingerprints."""
    import wsnsim.verification as verification

    answer = verification.verify(result)
    if as_json:
        echo_json({"ok": answer.ok, "rows": answer.rows})
    else:
        click.echo(answer.text)
    return 0 if answer.ok else 1


@group.command()
@result_argument
@click.option("--step", type=click.IntRange(min=0), required=True, metavar="K", help="Step to tell.")
@click.option(
    "--replicate", type=click.IntRange(min=0), default=0, show_default=True, metavar="R", help="Of which run."
)
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Of which target; default all.")
@click.option(
    "--limit",
    type=click.IntRange(min=0),
    default=4,
    show_default=True,
    metavar="N",
    help="Similar messages told one by one; more are summed.",
)
@json_option
def trace(result: Path, step: int, replicate: int, target: int | None, limit: int, as_json: bool) -> None:
    """Tell one step of a run: who sensed, who sent what to whom, what was lost, and what it cost."""
    from wsnsim.analysis import trace as tracing

    picked = tracing.trace(result, step, replicate, target, limit)
    if as_json:
        echo_json(tracing.as_json(picked))
    else:
        click.echo(tracing.text(picked))


@group.command()
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@json_option
def diff(a: Path, b: Path, as_json: bool) -> int:
    """Say where two results part; exit code 1 if they do, 2 if one cannot be read."""
    from wsnsim.analysis import difference, difference_text

    try:
        found = difference.differ(a, b)
    except ResultError as error:
        raise UsageError(str(error)) from error
    if as_json:
        echo_json(difference.as_json(found))
    else:
        click.echo(difference_text.text(found))
    return 0 if found.same else 1


@group.command()
@click.argument("left", metavar="X.tmp", type=click.Path(path_type=Path))
@click.option("--out", "-o", type=click.Path(path_type=Path), metavar="FILE.h5", help="Where to write what is left.")
def recover(left: Path, out: Path | None) -> None:
    """Copy out what a killed run left in its temporary file."""
    import wsnsim.recording as recording

    click.echo(f"{recording.recover(left, out)}: what was left, marked as partial")


def _loaded(source: str, overrides: Sequence[str]) -> Scenario:
    """The scenario of a file or name, or the one that a result holds."""
    import wsnsim.scenario as scenario

    if not _is_result(source):
        return scenario.load(source, overrides)
    import wsnsim.experiment as experiment

    return scenario.load(experiment.rerun_source(Path(source)), overrides)


def _is_result(source: str) -> bool:
    try:
        with Path(source).open("rb") as file:
            return file.read(len(HDF5_MARK)) == HDF5_MARK
    except (OSError, ValueError):
        return source.endswith(".h5")
