"""The commands of scenarios and results."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.cli.shared import (
    PATH,
    echo,
    echo_answer,
    echo_json_text,
    group,
    json_option,
    overrides_option,
    plugins_option,
    quiet_option,
    reading,
    result_argument,
)


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
    """Check scenarios without running them, and report every error.

    Notes name values that are allowed but probably not intended.
    """
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
    """List kinds of components, scenarios, sweeps or datasheets.

    ROLE is the role of the kinds (trackers, motions, ...), or `scenarios`, `sweeps` or `parts` (the datasheets of
    radios and processors that come with wsnsim). Without it, the kinds of all roles are listed.
    """
    from wsnsim.cli import listing

    echo_answer(listing.listed(role, as_json))


@group.command()
def schema() -> None:
    """Print the JSON Schema of scenarios, with installed plug-ins."""
    from wsnsim.scenario.json_schema import json_schema

    echo_json_text(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@group.command()
@result_argument
@plugins_option
@json_option
def verify(result: Path, plugins: bool, as_json: bool) -> int:
    """Run the scenario of a result again and compare all tables.

    The fingerprints and the source text of the scenario are compared, too.
    """
    import wsnsim.verification as verification

    answer = verification.verify(result, plugins)
    echo_answer({key: value for key, value in asdict(answer).items() if key != "text"} if as_json else answer.text)
    return 0 if answer.ok else 1


@group.command()
@result_argument
@click.option("--step", type=click.IntRange(min=0), required=True, metavar="K", help="Step to describe.")
@click.option(
    "--replicate", type=click.IntRange(min=0), default=0, show_default=True, metavar="R", help="Run to describe."
)
@click.option("--target", type=click.IntRange(min=0), metavar="T", help="Target to describe; default all.")
@click.option(
    "--limit",
    type=click.IntRange(min=0),
    default=4,
    show_default=True,
    metavar="N",
    help="Number of similar messages that are shown one by one; more are summed up.",
)
@json_option
def trace(result: Path, step: int, replicate: int, target: int | None, limit: int, as_json: bool) -> None:
    """Describe one step of a run: measurements, frames and energy.

    The text says who sensed the target, who sent what to whom, what was lost, and what energy was spent.
    """
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
    """Find the first difference between two results.

    The exit code is 1 if they differ, and 2 if one of them cannot be read.
    """
    from wsnsim.analysis import difference

    try:
        with reading(a, b):
            found = difference.differ(a, b)
    except ResultError as error:
        raise UsageError(str(error)) from error
    echo_answer(difference.as_json(found) if as_json else difference.text(found))
    return 0 if found.same else 1


@group.command()
@click.argument("unfinished", metavar="X.tmp", type=PATH)
@click.option("--out", "-o", type=PATH, metavar="FILE.h5", help="Result file; default the name that the run had.")
def recover(unfinished: Path, out: Path | None) -> None:
    """Recover the rows in the temporary file of a killed run."""
    import wsnsim.recording as recording

    echo(f"{recording.recover(unfinished, out)}: recovered, with the status partial")
