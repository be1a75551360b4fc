"""The command that says how long a network lives."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence, Sized
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import ScenarioError, UsageError, WsnsimError
from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import VISITS, display
from wsnsim.cli.shared import PATH, echo, echo_json, echo_lines, group, plot_path, writable

BLOCK: Final = (
    "intrusions", "profile", "horizon", "until", "error", "episodes", "paths", "tolerance", "coverage", "connected",
    "tracked",
)  # fmt: skip
"""Options that stand for keys of the scenario's block `lifetime`."""
HINTS: Final = {"--intrusions": "; 4/h is 4 an hour, 4 is 4 a second", "--horizon": "; 365 d is a year, 365 is 365 s"}
"""What messages on an option add."""
TABLES: Final = (".csv", ".gz")


@group.command()
@click.argument("sources", metavar="SCENARIO...|FILE.json", nargs=-1, required=True)
@click.option(
    "--intrusions", metavar="RATE|FILE.csv", help="Visits of a target: 1/h (the default), or a file of times."
)
@click.option("--profile", metavar="F,F,...", help="24 factors of the rate, one for each hour of a day.")
@click.option("--horizon", metavar="TIME", help="Time that is looked ahead; default 10 years (3652.5 d).")
@click.option("--until", metavar="CRITERION", help="Last criterion asked for: first_death, dead_10, half_dead, ...")
@click.option(
    "--error", metavar="SHARE", help="Error of the mean first death up to which visits are added; default 5 %."
)
@click.option("--episodes", metavar="K", help="Largest number of simulated visits before the first death; default 192.")
@click.option("--paths", metavar="R", help="Number of sample paths; default 200.")
@click.option("--tolerance", metavar="TIME", help="Interruptions up to this time do not count; default 0 s.")
@click.option("--coverage", metavar="SHARE", help="Share of the covered area below which coverage ends; default 90 %.")
@click.option(
    "--connected", metavar="SHARE", help="Share of nodes with a route below which sinks are cut off; default 50 %."
)
@click.option("--tracked", metavar="SHARE", help="Share of the tracked steps below which tracking ends; default 90 %.")
@click.option("--trackers", metavar="A,B,...", help="Compare these trackers: 'pf:particles=1000,ekf'.")
@click.option("--vary", multiple=True, metavar="KEY=VALUES", help="Compare values of a key: mac.interval='125 ms,1 s'.")
@shared.overrides_option
@shared.seed_option
@shared.jobs_option
@click.option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler: tcp://host:8786.")
@click.option("--out", "-o", type=PATH, metavar="FILE.json", help="Result; default results/NAME.lifetime.json.")
@click.option("--plot", "figure", type=PATH, metavar="PLOT", help="Also write the figures: .png, .svg or .pdf.")
@click.option("--page", type=PATH, metavar="PAGE.html", help="Also write an HTML page.")
@shared.plugins_option
@shared.json_option
@shared.quiet_option
@shared.progress_option
@click.pass_obj
def lifetime(interrupts: Interrupts, /, sources: tuple[str, ...], **given: Any) -> None:
    """Say how long a network lives.

    Each scenario is one visit of its target, which comes again and again. Several scenarios, --trackers and --vary are
    compared in a table. Visits are kept in a folder beside the result: the same command goes on where it was stopped.
    FILE.json is a result, which is shown again.
    """
    from wsnsim.analysis import lifetime_result, lifetime_text

    figure, page = given["figure"], given["page"]
    if figure is not None:
        plot_path(figure, option="--plot")
    if page is not None:
        writable(page, Path("page.html"), "--page")
    if len(sources) == 1 and lifetime_result.is_lifetime(sources[0]):
        _demand_plottable(points := lifetime_result.read(Path(sources[0])), figure)
    else:
        points = _estimated(sources, interrupts, given)
    if figure is not None:
        from wsnsim.analysis import lifetime_plots

        lifetime_plots.write(points[0], figure)
    if page is not None:
        from wsnsim.report import lifetime_page

        lifetime_page.write(points, page)
    if given["as_json"]:
        echo_json({"answers": list(map(lifetime_text.answer, points)), "points": points})
    else:
        echo(lifetime_text.text(points))


def _estimated(sources: Sequence[str], interrupts: Interrupts, given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The outcomes of all scenarios with their labels, which are written to the result."""
    from wsnsim.analysis import lifetime_result
    from wsnsim.campaign.sweeping import engine_of
    from wsnsim.campaign.visits import estimate_lifetime
    from wsnsim.lifetimes.planning import lifetime_plan
    from wsnsim.recording.atomic_files import sole_writer

    if given["jobs"] and given["scheduler"]:
        raise UsageError("--jobs cannot be combined with --scheduler: the scheduler sets the number of workers")
    with _named_as_options(given):
        scenarios = _scenarios(sources, given)
        for scenario in scenarios.values():
            lifetime_plan(scenario)  # all are checked before one is simulated
    _demand_plottable(scenarios, given["figure"])
    path = writable(given["out"], Path("results") / f"{next(iter(scenarios.values())).name}.lifetime.json")
    folder, points = path.with_suffix(".visits"), []
    engine = partial(engine_of, folder, given["jobs"], given["scheduler"])
    mode, before = "none" if given["quiet"] else given["progress"], lifetime_result.settings(path)
    try:
        with sole_writer(path):
            for number, (label, scenario) in enumerate(scenarios.items(), 1):
                if len(scenarios) > 1 and mode != "none":
                    echo_lines([f"wsnsim: {number} of {len(scenarios)}: {label}"])
                with contextlib.closing(display(mode, VISITS)) as shown:
                    found = estimate_lifetime(scenario, folder, engine, report=shown.step, stopping=interrupts.noted)
                points.append({"label": label, **found})
            lifetime_result.write(path, points, shared.command_line())
    except KeyboardInterrupt:
        echo_lines([f"wsnsim: finished visits are in {folder}; the same command goes on with them"])
        raise
    if not given["quiet"]:
        replaced = " in place of the answer of other settings" * (before not in ([], lifetime_result.settings(path)))
        echo_lines([f"wsnsim: {path}: written{replaced}; show it again with: wsnsim info {path}"])
    return points


def _demand_plottable(shown: Sized, figure: Path | None) -> None:
    """Raise UsageError if there is to be a plot of several scenarios."""
    if figure is not None and len(shown) > 1:
        raise UsageError("--plot shows one scenario; --page shows several")


def _scenarios(sources: Sequence[str], given: Mapping[str, Any]) -> dict[str, Any]:
    """The scenarios by their labels."""
    overrides = (*given["overrides"], *_of_block(given))
    shared.demand_no_trackers("lifetime", sources, given["trackers"])
    if len(sources) == 1 and not given["vary"] and not given["trackers"]:
        scenario = shared.loaded(sources[0], overrides, given["plugins"])
        return {scenario.name: scenario}
    import json

    from wsnsim.scenario import load
    from wsnsim.scenario.sweep import load_sweep

    name = "_".join(Path(source).stem for source in sources)[:60]
    plan = load_sweep(list(sources), given["vary"], overrides, given["trackers"], name=name)
    return {
        ", ".join(itertools.starmap(_shown, point.settings.items())): load({**json.loads(point.resolved), "name": name})
        for point in plan.points
    }


def _shown(key: str, value: Any) -> str:
    """A setting of a variant: its value, with its key where that does not begin with a letter."""
    if key == "lifetime.intrusions" and value is not None:
        value = f"{3600.0 * value:.10g}/h"
    if isinstance(value, str) and value[:1].isalpha():
        return value
    return f"{key} = {value:.10g}" if isinstance(value, float) else f"{key} = {value}"


def _of_block(given: Mapping[str, Any]) -> Iterator[Any]:
    """The overrides that options of the block `lifetime`, and the seed, stand for."""
    if given["seed"] is not None:
        yield f"seed={given['seed']}"
    for name, value in ((name, given[name]) for name in BLOCK if given[name] is not None):
        if name == "intrusions" and value.endswith(TABLES):
            yield "lifetime.times", _times(value)
        else:
            yield f"lifetime.{name}=" + (f"[{value}]" if name == "profile" else value)


def _times(file: str) -> list[float]:
    """The times in a CSV file with the column `time` in s."""
    from wsnsim.models.csvfile import timed_rows

    try:
        return [float(time) for time in timed_rows(file, "times").numbers["time"]]
    except WsnsimError as error:
        raise UsageError(f"--intrusions: {error}") from None


@contextlib.contextmanager
def _named_as_options(given: Mapping[str, Any]) -> Iterator[None]:
    """Name the options of this command where an issue names the key that they stand for."""
    from wsnsim.api.arguments import renamed

    named = {name: f"--{name}" for name in BLOCK if given[name] is not None}
    if str(given["intrusions"]).endswith(TABLES):
        named["times"] = f"--intrusions {given['intrusions']}"
    keys = {f"{start}lifetime.{name}": option for start in ("--set ", "") for name, option in named.items()}
    try:
        with renamed(keys):
            yield
    except ScenarioError as error:
        raise ScenarioError(
            dataclasses.replace(issue, message=issue.message + HINTS.get(issue.place, "")) for issue in error.issues
        ) from error.__cause__
