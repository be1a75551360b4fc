"""The commands of scenarios and results."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.garbage import put_off
from wsnsim.cli.progress import RUN, display
from wsnsim.cli.shared import (
    PATH,
    batch_option,
    command_line,
    echo,
    echo_answer,
    echo_json_text,
    group,
    is_campaign,
    json_option,
    loaded,
    overrides_option,
    plugins_option,
    progress_option,
    quiet_option,
    reading,
    result_argument,
    seed_option,
    writable,
)

if TYPE_CHECKING:
    from wsnsim.experiment import Report
    from wsnsim.scenario.schema import Scenario


@group.command()
@click.argument("source", metavar="SCENARIO")
@overrides_option
@click.option("--replicates", type=click.IntRange(min=1), metavar="N", help="Number of Monte Carlo runs.")
@seed_option
@click.option("--out", "-o", type=PATH, metavar="FILE.h5", help="Result file; default results/NAME.h5.")
@click.option("--report", "with_page", is_flag=True, help="Also write the result's HTML page, beside the result.")
@plugins_option
@json_option
@batch_option
@quiet_option
@progress_option
def run(
    source: str,
    overrides: tuple[str, ...],
    replicates: int | None,
    seed: int | None,
    out: Path | None,
    with_page: bool,
    plugins: bool,
    as_json: bool,
    batch: bool,
    quiet: bool,
    progress: str,
) -> None:
    """Run a scenario and write its result."""
    seeded = overrides if seed is None else (*overrides, f"seed={seed}")
    scenario = loaded(source, seeded, plugins)
    path = writable(out, Path("results") / f"{scenario.name}.h5")
    page = _page_path(path) if with_page else None
    with put_off():
        import wsnsim.experiment as experiment

    talks = not quiet and progress not in ("json", "none")
    if talks:
        _say_notes(scenario, replicates or scenario.replicates, batch)
    with contextlib.closing(display("none" if quiet else progress, RUN)) as shown:
        report = experiment.run(
            scenario, replicates=replicates, out=path, command_line=command_line(), progress=shown.step,
            on_compile=_say_compiling if talks else None, batch=batch,
        )  # fmt: skip
    if talks and report.compiled:
        echo(f"wsnsim: compiling kernels, once: {report.compiled:.1f} s, no part of the CPU time", err=True)
    echo_answer(_summary(report, scenario, as_json))
    if page:
        import wsnsim.report as pages
        from wsnsim.papers.published import published

        written = pages.write([path], page, published=published, plugins=True)  # they have just run
        if not quiet:
            echo(f"wsnsim: {written.path}: {written.size / 1e6:.2f} MB; open it in a browser", err=True)


def _say_notes(scenario: Scenario, replicates: int, batch: bool) -> None:
    """Print, before the runs of a scenario, what is hardly meant in it, and how large they are if that is much."""
    from wsnsim.analysis import run_size, setup_notes
    from wsnsim.scenario import build

    setup = build(scenario)
    size = run_size.run_size(setup, replicates, batch)
    for note in (*setup_notes.before_a_run(setup), run_size.warning(size, run_size.free_memory())):
        if note:
            echo(f"wsnsim: note: {note}", err=True)


def _say_compiling() -> None:
    echo("wsnsim: compiling kernels, once ...", err=True)


def _summary(report: Report, scenario: Scenario, as_json: bool) -> str | dict[str, Any]:
    """The summary of a run, with the values that its paper publishes."""
    if not report.states:
        from wsnsim.analysis import beaconing

        return beaconing.as_json(report) if as_json else beaconing.text(report)
    from wsnsim.analysis import summary, summary_text
    from wsnsim.papers.published import published
    from wsnsim.scenario import resolved

    values, paper = published(resolved(scenario))
    limit = summary.bounds_of_report(report)
    return summary.as_json(report, values, limit) if as_json else summary_text.text(report, values, paper, limit)


def _page_path(result: Path) -> Path:
    """The path of the result's page.

    Raises:
        UsageError: the page cannot be written there. It is checked before anything runs.
    """
    page = result.with_suffix(".html")
    if page == result or (page.exists() and result.exists() and page.samefile(result)):
        raise UsageError(f"--report: the page would overwrite {result}; give --out {result.with_suffix('.h5')}")
    try:
        return writable(page, Path(page.name))
    except UsageError as error:
        raise UsageError(f"--report: {str(error).removeprefix('--out ')}") from None


@group.command()
@click.argument("sources", metavar="SCENARIO...", nargs=-1, required=True)
@overrides_option
@plugins_option
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.1),
    default=20.0,
    show_default=True,
    metavar="SECONDS",
    help="Time limit of a scenario's plug-ins, which run in a process of their own.",
)
@quiet_option
def check(sources: tuple[str, ...], overrides: tuple[str, ...], plugins: bool, timeout: float, quiet: bool) -> int:
    """Check scenarios without running them, and report every error; notes on what is hardly meant."""
    from wsnsim.cli import checking

    code = 0
    for source in sources:
        found = checking.check(checking.CheckRequest(source, overrides, plugins), timeout)
        for line in found.errors:
            echo(line, err=True)
        for line in found.lines:
            echo(line)
        code = max(code, found.code)
    return code


@group.command("list")
@click.argument("role", required=False)
@json_option
def list_(role: str | None, as_json: bool) -> None:
    """List the kinds of every role or of one (trackers, motions, ...), or the shipped scenarios, sweeps or parts."""
    from wsnsim.cli import listing

    echo_answer(listing.listed(role, as_json))


@group.command()
def schema() -> None:
    """Print the JSON Schema of scenarios, including installed plug-ins."""
    from wsnsim.scenario.json_schema import json_schema

    echo_json_text(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@group.command()
@click.argument("name")
@click.option("--bench", is_flag=True, help="A standalone filter, without a network.")
def new(name: str, bench: bool) -> None:
    """Write NAME.yaml, a commented scenario as a starting point."""
    from wsnsim.scenario.schema import unsafe_name
    from wsnsim.scenario.template import template

    stem = name.removesuffix(".yaml")
    if reason := unsafe_name(stem, "a file"):
        raise UsageError(f"'{name}' {reason}")
    path = Path(f"{stem}.yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(template(stem, bench))
    except FileExistsError:
        raise UsageError(f"file exists: {path}") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from None
    echo(f"{path}: written; run it with: wsnsim run {path}")


@group.command()
@click.argument("source", metavar="FILE|NAME")
@plugins_option
@json_option
def info(source: str, plugins: bool, as_json: bool) -> None:
    """Describe a result, a campaign's folder, a datasheet (`wsnsim list parts`), or a scenario's radio."""
    from wsnsim.scenario.files import is_result

    if is_campaign(source):
        from wsnsim.analysis import campaign_info

        echo_answer(campaign_info.info(source) if as_json else campaign_info.info_text(source))
    elif source.endswith(".h5") or is_result(source):
        from wsnsim.analysis import result_info

        with reading(Path(source)):
            answer = result_info.info(Path(source)) if as_json else result_info.info_text(Path(source))
        echo_answer(answer)
    else:
        from wsnsim.cli import component_info

        found = component_info.describe(source, plugins)
        echo_answer(found.as_json() if as_json else found.text())


@group.command()
@result_argument
@plugins_option
@json_option
def verify(result: Path, plugins: bool, as_json: bool) -> int:
    """Run a result's scenario again and compare every table, the fingerprints and the source text."""
    import wsnsim.verification as verification

    answer = verification.verify(result, plugins)
    echo_answer({key: value for key, value in asdict(answer).items() if key != "text"} if as_json else answer.text)
    return 0 if answer.ok else 1


@group.command()
@result_argument
@click.option("--step", type=click.IntRange(min=0), required=True, metavar="K", help="Step to describe.")
@click.option("--replicate", type=click.IntRange(min=0), default=0, show_default=True, metavar="R", help="Run.")
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target; default all.")
@click.option(
    "--limit",
    type=click.IntRange(min=0),
    default=4,
    show_default=True,
    metavar="N",
    help="Similar messages shown one by one; more are summed up.",
)
@json_option
def trace(result: Path, step: int, replicate: int, target: int | None, limit: int, as_json: bool) -> None:
    """Describe one step of a run: who sensed, who sent what to whom, what was lost, and the energy spent."""
    from wsnsim.analysis import trace as tracing

    with reading(result):
        picked = tracing.trace(result, step, replicate, target, limit)
        answer = tracing.as_json(picked) if as_json else tracing.text(picked)
    echo_answer(answer)


@group.command()
@click.argument("a", metavar="A", type=PATH)
@click.argument("b", metavar="B", type=PATH)
@json_option
def diff(a: Path, b: Path, as_json: bool) -> int:
    """Find the first difference of two results; exit code 1 if they differ, 2 if one cannot be read."""
    from wsnsim.analysis import difference, difference_text

    try:
        with reading(a, b):
            found = difference.differ(a, b)
    except ResultError as error:
        raise UsageError(str(error)) from error
    echo_answer(difference.as_json(found) if as_json else difference_text.text(found))
    return 0 if found.same else 1


@group.command()
@click.argument("unfinished", metavar="X.tmp", type=PATH)
@click.option("--out", "-o", type=PATH, metavar="FILE.h5", help="Result file; default the name that the run had.")
def recover(unfinished: Path, out: Path | None) -> None:
    """Recover the rows in the temporary file of a killed run."""
    import wsnsim.recording as recording

    echo(f"{recording.recover(unfinished, out)}: recovered, with the status partial")
