"""One session of a campaign from the command line: begin it or go on with it, run, answer, and say what is left."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, clock, shown
from wsnsim.cli.shared import command_line, echo_json

if TYPE_CHECKING:
    from wsnsim.campaign import Ended, Part
    from wsnsim.campaign.engines import Engine
    from wsnsim.recording.folder import Folder, Manifest
    from wsnsim.scenario.sweep_schema import Plan

INCOMPLETE: Final = 3
METRIC: Final = "rmse"
"""The figure that is compared where nobody asks for another."""
FEW: Final = 5


class Said(NamedTuple):
    """What is said of a campaign's results, and where."""

    metric: str
    by: tuple[str, ...]
    baseline: str | None
    csv: Path | None
    as_json: bool
    bound: bool


class Choices(NamedTuple):
    """How a campaign is run, and what is said of it: the options that sweep and compare share."""

    out: Path | None
    jobs: int | None
    scheduler: str | None
    scheduler_file: Path | None
    shard: str | None
    dry_run: bool
    quiet: bool
    progress: str
    said: Said


def carried_out(plan: Plan, chosen: Choices, interrupts: Interrupts, by: tuple[str, ...]) -> int:
    """Begin a campaign, or go on with it as its sweep says it now."""
    import wsnsim.campaign as campaign
    from wsnsim.recording.folder import Folder

    place = chosen.out or Path("results") / plan.name
    part = _part(chosen.shard)
    _demand_answerable(chosen.said, plan, by)
    _demand_one_engine(chosen)
    if chosen.dry_run:
        from wsnsim.campaign.estimate import estimate

        campaign.earlier(Folder(place), plan.name)
        _tell_estimate(plan.name, estimate(plan, Folder(place), _workers(chosen), part), chosen)
        return 0
    folder = campaign.begin(plan, place, by=by, baseline=chosen.said.baseline, command_line=command_line())
    return _run(folder, part, chosen, interrupts)


def gone_on_with(source: str, chosen: Choices, interrupts: Interrupts) -> int:
    """Go on with the campaign of a folder."""
    import wsnsim.campaign as campaign

    if chosen.dry_run:
        raise UsageError("--dry-run takes a sweep; `wsnsim info DIR` says how far a campaign is")
    part = _part(chosen.shard)
    folder = campaign.go_on(source)
    _demand_one_engine(chosen)
    manifest = folder.manifest()
    _demand_answerable(chosen.said, manifest, chosen.said.by or manifest.by)
    return _run(folder, part, chosen, interrupts)


def _run(folder: Folder, part: Part, chosen: Choices, interrupts: Interrupts) -> int:
    """Run what is missing, print the figures, and say what is missing still."""
    import wsnsim.campaign as campaign

    engine = _engine(folder, chosen)
    show = None if chosen.quiet else shown(chosen.progress, of=CAMPAIGN)
    with interrupts.noted() as stop:
        try:
            ended = campaign.drive(folder, engine, part, show.step if show else None, stop)
        except KeyboardInterrupt:
            say([f"wsnsim: go on with: {_resume(folder, part, chosen)}"])
            raise
        finally:
            if show:
                show.close()
    code = 0
    if part == campaign.ALL and not interrupts.number:
        code = answer(folder, chosen.said)
    return _last_words(folder, ended, part, chosen, interrupts) or code


def _engine(folder: Folder, chosen: Choices) -> Engine:
    if chosen.scheduler is not None or chosen.scheduler_file is not None:
        from wsnsim.campaign.cluster import DaskCluster

        return DaskCluster(folder.path, chosen.scheduler, chosen.scheduler_file)
    from wsnsim.campaign.local import LocalPool

    return LocalPool(_workers(chosen))


def _demand_one_engine(chosen: Choices) -> None:
    """Raise UsageError, before anything is written, where what is asked for excludes each other."""
    if chosen.scheduler is not None and chosen.scheduler_file is not None:
        raise UsageError("give either --scheduler or --scheduler-file")
    if chosen.jobs and (chosen.scheduler is not None or chosen.scheduler_file is not None):
        raise UsageError("--jobs has no meaning with a scheduler: it has the workers that it has")


def _workers(chosen: Choices) -> int:
    from wsnsim.campaign.local import cores

    return chosen.jobs or cores()


def answer(folder: Folder, chosen: Said) -> int:
    """Print the figures of what is there; the exit code, 1 if there are none or a file cannot be read."""
    from wsnsim.analysis import comparison, comparison_text
    from wsnsim.base.errors import ResultError

    try:
        found = comparison.compare(folder, chosen.metric, chosen.by or None, chosen.baseline)
    except ResultError as error:
        damaged = [place for point in folder.manifest().points for place in folder.set_aside(point.id)]
        if not damaged:
            say([f"wsnsim: error: {error}"])
            return error.exit_code
        say([f"wsnsim: {place}: was damaged, and is put aside: its replicates are missing now" for place in damaged])
        say([f"wsnsim: go on with: wsnsim sweep {shlex.quote(str(folder.path))}"])
        return INCOMPLETE
    if chosen.bound:
        from wsnsim.analysis import comparison_bounds

        found = comparison_bounds.with_bounds(found, folder)
    if chosen.csv:
        _write_csv(found.table, chosen.csv)
    if chosen.as_json:
        echo_json({**comparison.as_json(found), "folder": str(folder.path)})
    else:
        click.echo(comparison_text.text(found))
    return 0


def _demand_answerable(said: Said, plan: Plan | Manifest, by: Sequence[str]) -> None:
    """Raise UsageError, before anything runs, if what is asked of the results cannot be answered, or not written."""
    from wsnsim.analysis import comparison
    from wsnsim.base.errors import did_you_mean
    from wsnsim.base.tables import METRICS

    if said.metric not in METRICS:
        raise UsageError(f"--metric: table runs has no figure '{said.metric}' ({did_you_mean(said.metric, METRICS)})")
    for key in said.by:
        if key not in plan.keys:
            raise UsageError(f"--by: the campaign varies no '{key}' ({did_you_mean(key, plan.keys)})")
    comparison.demand_baseline(plan, by, said.baseline)
    if said.csv and (said.csv.is_dir() or not said.csv.parent.is_dir()):
        raise UsageError(f"--csv {said.csv}: give a file in a folder that there is")


def _write_csv(table: Any, place: Path) -> None:
    try:
        table.to_csv(place, index=False)
    except OSError as error:
        raise UsageError(f"cannot write {place}: {error.strerror or error}") from None


def _last_words(folder: Folder, ended: Ended, part: Part, chosen: Choices, interrupts: Interrupts) -> int:
    """What is missing, why, and how to go on; the exit code."""
    import wsnsim.campaign as campaign

    manifest = folder.manifest()
    points, more = folder.unasked(manifest)
    if (points or more) and not chosen.quiet:
        said = (
            f"{points} points and {more} further replicates in {folder.path} are not of the campaign as it is asked for"
        )
        say([f"wsnsim: {said} now; they are kept"])
    lines = [f"wsnsim: {task} failed: {words}" for task, words in list(ended.failed.items())[:FEW]]
    if len(ended.failed) > FEW:
        lines.append(f"wsnsim: and {len(ended.failed) - FEW} tasks more failed; {folder.path / 'failed'} says why")
    if ended.stopped and not interrupts.number:
        lines.append(f"wsnsim: error: the campaign was stopped: {ended.stopped}")
    if ended.missing:
        count = sum(map(len, ended.missing.values()))
        lines += [f"wsnsim: {folder.path} is incomplete, {count} replicates are missing:"]
        lines += campaign.missing_words(ended.missing, manifest)
        lines += [f"wsnsim: go on with: {_resume(folder, part, chosen)}"]
    elif part != campaign.ALL and not chosen.quiet:
        lines.append(
            f"wsnsim: part {part.number} of {part.of} is done: {ended.done} replicates, {ended.found} were there"
        )
    say(lines)
    if interrupts.number:
        say([f"wsnsim: {interrupts.words}"])
        return interrupts.code
    return INCOMPLETE if not ended.complete or ended.stopped else 0


def _resume(folder: Folder, part: Part, chosen: Choices) -> str:
    """The command that goes on with it."""
    words = ["wsnsim", "sweep", str(folder.path)]
    if part.of > 1:
        words += ["--shard", f"{part.number}/{part.of}"]
    for name in ("jobs", "scheduler", "scheduler_file"):
        if (value := getattr(chosen, name)) is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    said = chosen.said
    words += ["--metric", said.metric] if said.metric != METRIC else []
    words += [word for key in said.by for word in ("--by", key)]
    for name in ("baseline", "csv"):
        if (value := getattr(said, name)) is not None:
            words += [f"--{name}", str(value)]
    words += [f"--{name}" for name, wanted in (("bound", said.bound), ("json", said.as_json)) if wanted]
    return shlex.join(words)


def say(lines: Sequence[str]) -> None:
    """Lines on stderr."""
    for line in lines:
        click.echo(line, err=True)


def _part(shard: str | None) -> Part:
    from wsnsim.campaign import ALL, Part

    if shard is None:
        return ALL
    number, sign, of = shard.partition("/")
    if not (sign and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise UsageError(f"--shard takes I/N with 1 <= I <= N, such as 1/2, not '{shard}'")
    return Part(int(number), int(of))


def _tell_estimate(name: str, found: Any, chosen: Choices) -> None:
    """What --dry-run says."""
    import dataclasses
    import math

    if chosen.said.as_json:
        echo_json({"name": name, **dataclasses.asdict(found)})
        return
    size = "unknown" if math.isnan(found.size) else f"{found.size / 1e6:.1f} MB"
    click.echo(f"{name}: {found.points} points, {found.replicates} replicates, of which {found.done} are there")
    click.echo(f"  left   {found.left} replicates in {found.tasks} tasks")
    click.echo(f"  time   {clock(found.wall_seconds)} ({clock(found.cpu_seconds)} of one core)")
    click.echo(f"  size   {size}")
    click.echo(f"  reckoned from {found.source}")
