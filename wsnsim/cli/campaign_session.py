"""One session of a campaign from the command line: prepare or resume, run, compare, and report what is missing.

What is compared is checked before anything runs. `--dry-run` prints what a campaign will cost.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import wsnsim.campaign as campaign
from wsnsim.analysis import campaign_info  # not comparison: pandas may start a thread, and workers would be spawned
from wsnsim.base.errors import ResultError, UsageError, counted, did_you_mean, printable
from wsnsim.base.tables import METRICS
from wsnsim.campaign import WHOLE, CampaignOutcome, Shard, engines, needs_permission
from wsnsim.campaign.sweeping import CostEstimate, engine_of, estimate_cost
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, display, duration
from wsnsim.cli.running import LiveOptions, linger, shown_live
from wsnsim.cli.shared import INCOMPLETE, METRIC, command_line, echo, echo_json, echo_lines, seconds_of, writable
from wsnsim.recording.atomic_files import write_text_atomically
from wsnsim.recording.folder import Folder, Manifest
from wsnsim.scenario.registry import PluginAccess, Plugins, access
from wsnsim.scenario.sweep_schema import Plan

Options = SimpleNamespace
"""The values of the options that `sweep` and `compare` share: how a campaign is run, and what is compared."""


def print_estimate(name: str, estimate: CostEstimate, as_json: bool) -> None:
    """Print the answer of --dry-run."""
    if as_json:
        echo_json({"name": name, **dataclasses.asdict(estimate)})
        return
    size = "unknown" if math.isnan(estimate.size) else f"{estimate.size / 1e6:.1f} MB"
    echo(f"{name}: {estimate.points} points, {estimate.replicates} runs, {estimate.done} of them done")
    echo(f"  missing  {estimate.left} runs in {estimate.tasks} tasks")
    echo(f"  time     {duration(estimate.wall_seconds)} ({duration(estimate.cpu_seconds)} of CPU time)")
    echo(f"  size     {size}")
    echo(f"  estimated from {estimate.source}")


def check_comparison(options: Options, plan: Plan | Manifest, by: Sequence[str]) -> None:
    """Raise UsageError, before anything runs, if the comparison would fail or could not be written."""
    if options.metric not in METRICS:
        nearest = did_you_mean(options.metric, METRICS)
        raise UsageError(f"--metric: table runs has no metric '{options.metric}' ({nearest})")
    for key in options.by:
        if key not in plan.keys:
            raise UsageError(f"--by: the campaign does not vary '{key}' ({did_you_mean(key, plan.keys)})")
    campaign_info.baseline_point(plan, tuple(by) or campaign_info.keys_by_default(plan.keys), options.baseline)
    for name, path, suffix in (("--csv", options.csv, ".csv"), ("--latex", options.latex, ".tex")):
        if path and path.suffix != suffix and not path.is_dir():
            raise UsageError(f"{name} {path} must end in {suffix}")
        if path:
            writable(path, Path(f"comparison{suffix}"), name)


def print_comparison(folder: Folder, options: Options, plugins: Plugins | None = None) -> int:
    """Print the comparison of what is on disk. `plugins`: which ones its scenarios may name, if bounds are shown.

    Returns:
        The exit code: 1 if there are no results, 3 if a damaged file was set aside.
    """
    from wsnsim.analysis import comparison, comparison_text

    try:
        found = comparison.compare(folder, options.metric, options.by or None, options.baseline)
    except ResultError as error:
        damaged = folder.all_set_aside()
        if not damaged:
            echo_lines([f"wsnsim: error: {error}"])
            return error.exit_code
        echo_lines([f"wsnsim: {path}: is damaged and was set aside; its runs are missing now" for path in damaged])
        allowed = " --plugins" * needs_permission(folder)
        echo_lines([f"wsnsim: resume with: wsnsim sweep {shlex.quote(str(folder.path))}{allowed}"])
        return INCOMPLETE
    if options.bound:
        from wsnsim.analysis import error_bounds

        found = error_bounds.with_bounds(found, folder, plugins)
    if options.csv:
        shown = found.table.map(lambda value: printable(value) if isinstance(value, str) else value)
        write_text_atomically(options.csv, shown.to_csv(index=False))
    if options.latex:
        write_text_atomically(options.latex, comparison_text.latex(found))
    if options.as_json:
        answer = {"answer": comparison_text.answer(found), "folder": str(folder.path)}
        echo_json({**comparison.as_json(found), **answer, **campaign_info.code_json(folder)})
    else:
        more = [] if options.explain else ["  what the columns mean: --explain"]
        echo("\n".join([comparison_text.text(found, options.explain), *more, *campaign_info.code_lines(folder)]))
    return 0


MAX_FAILURES: Final = 5
"""Failures that are printed."""


def options_of(given: dict[str, Any]) -> tuple[Options, tuple[str, ...], dict[str, Any]]:
    """The options of a session, the overrides with the seed, and the changes of the sweep (replicates, timeout)."""
    overrides, seed = given.pop("overrides"), given.pop("seed")
    seeded = overrides if seed is None else (*overrides, f"seed={seed}")
    changes = {name: given.pop(name) for name in ("replicates", "timeout")}
    if changes["timeout"] is not None:
        changes["timeout"] = seconds_of("--timeout", changes["timeout"])
    return Options(**given), seeded, changes


def run_plan(plan: Plan, options: Options, interrupts: Interrupts, by: tuple[str, ...]) -> int:
    """Prepare the campaign of a sweep, or resume it, run what is missing, and return the exit code."""
    path = options.out or Path("results") / plan.name
    shard = _shard(options.shard)
    check_comparison(options, plan, by)
    _check_engine_options(options)
    if options.dry_run:
        campaign.existing_manifest(Folder(path), plan.name)
        estimate = estimate_cost(plan, Folder(path), options.jobs or engines.available_cores(), shard, options.batch)
        print_estimate(plan.name, estimate, options.as_json)
        return 0
    folder = campaign.prepare(
        plan, path, by=by, baseline=options.baseline, command_line=command_line(),
        accept_code_change=options.accept_code_change,
    )  # fmt: skip
    return _run(folder, shard, options, interrupts, access(Plugins.ANY))


def resume(source: str, options: Options, interrupts: Interrupts, changes: Sequence[Any]) -> int:
    """Resume the campaign in a folder and return the exit code. `changes`: what was given that would change it."""
    if any(changes) or options.out:
        raise UsageError(f"{source} is a campaign, whose sweep is fixed; to change it, give the sweep file instead")
    if options.dry_run:
        raise UsageError("--dry-run needs a sweep; `wsnsim info DIR` shows the progress of a campaign")
    shard, allowed = _shard(options.shard), access(Plugins.ANY if options.plugins else Plugins.INSTALLED)
    folder = campaign.reopen(source, options.accept_code_change)
    campaign.demand_permitted(folder, allowed.plugins)
    _check_engine_options(options)
    manifest = folder.manifest()
    check_comparison(options, manifest, options.by or manifest.by)
    if (difference := campaign.differing_code(manifest)) and not options.quiet:
        echo_lines([f"wsnsim: {folder.path} is complete and only shown: {difference}"])
    return _run(folder, shard, options, interrupts, allowed)


def _run(folder: Folder, shard: Shard, options: Options, interrupts: Interrupts, allowed: PluginAccess) -> int:
    """Run what is missing, print the comparison, say what is still missing, and show it as long as it is watched."""
    engine = engine_of(folder.path, options.jobs, options.scheduler, options.scheduler_file)
    if not options.quiet and (others := folder.outside_manifest(folder.manifest())):
        beside = f"also holds {counted(others, 'run')} of other settings, which are kept and not shown"
        echo_lines([f"wsnsim: {folder.path} {beside}; another --out keeps them apart"])

    def view_at(port: int) -> Any:
        from wsnsim.watch.campaign_view import CampaignView

        return CampaignView(folder, options.metric, port=port)

    with shown_live(LiveOptions() if options.live else None, view_at) as view:
        with view.following() if view else contextlib.nullcontext():
            # a signal stops the campaign, a second one at once
            shown = display("none" if options.quiet else options.progress, CAMPAIGN)
            with interrupts.noted() as should_stop, contextlib.closing(shown):
                try:
                    outcome = campaign.run_campaign(
                        folder, engine, shard, shown.step, should_stop, options.batch, allowed
                    )
                except KeyboardInterrupt:
                    echo_lines([f"wsnsim: resume with: {_resume_command(folder, shard, options)}"])
                    raise
        code = 0
        if shard == WHOLE and not interrupts.number:
            code = print_comparison(folder, options, allowed.plugins)
        code = _report_outcome(folder, outcome, shard, options, interrupts) or code
        if view and not interrupts.number:
            linger("the address still shows the campaign; ", options.quiet, interrupts, view.look)
    return code


def _check_engine_options(options: Options) -> None:
    """Raise UsageError, before anything is written, if options exclude each other."""
    if options.scheduler is not None and options.scheduler_file is not None:
        raise UsageError("--scheduler cannot be combined with --scheduler-file")
    if options.live and options.dry_run:
        raise UsageError("--watch cannot be combined with --dry-run: nothing is run")
    if options.jobs and (options.scheduler is not None or options.scheduler_file is not None):
        raise UsageError("--jobs cannot be combined with --scheduler: the scheduler sets the number of workers")


def _report_outcome(
    folder: Folder, outcome: CampaignOutcome, shard: Shard, options: Options, interrupts: Interrupts
) -> int:
    """Print what failed, what is missing and how to resume; return the exit code."""
    manifest = folder.manifest()
    lines = [f"wsnsim: worker {worker} was left out: it {why}" for worker, why in outcome.left_out.items()]
    failures = campaign.describe_failed(outcome.failed, manifest)
    lines += [f"wsnsim: {said}" for said in failures[:MAX_FAILURES]]
    if (more := len(failures) - MAX_FAILURES) > 0:
        lines.append(f"wsnsim: {more} more failures; see {folder.path / 'failed'}")
    if outcome.stopped and not interrupts.number:
        lines.append(f"wsnsim: error: the campaign was stopped: {outcome.stopped}")
    if outcome.missing:
        count = sum(map(len, outcome.missing.values()))
        lines += [f"wsnsim: {folder.path} is incomplete, runs missing: {count}"]
        possible = {point: runs for point, runs in outcome.missing.items() if point not in outcome.failed}
        lines += campaign.describe_missing(possible, manifest)
        lines += [f"wsnsim: resume with: {_resume_command(folder, shard, options)}"] if possible else []
    elif shard != WHOLE and not options.quiet:
        counts = f"{outcome.done} runs done, {outcome.found} existed before"
        lines.append(f"wsnsim: shard {shard.number} of {shard.total} is complete: {counts}")
    echo_lines(lines)
    if interrupts.number:
        echo_lines([f"wsnsim: {interrupts.reason}"])
        return interrupts.code
    return INCOMPLETE if not outcome.complete or outcome.stopped else 0


def _resume_command(folder: Folder, shard: Shard, options: Options) -> str:
    """The command that resumes the campaign."""
    words = ["wsnsim", "sweep", str(folder.path)]
    if shard.total > 1:
        words += ["--shard", f"{shard.number}/{shard.total}"]
    for name in ("jobs", "scheduler", "scheduler_file", "metric", "baseline", "csv", "latex"):
        value = getattr(options, name)
        if value is not None and (name, value) != ("metric", METRIC):
            words += [f"--{name.replace('_', '-')}", str(value)]
    words += [word for key in options.by for word in ("--by", key)]
    words += [] if options.batch else ["--no-batch"]
    words += ["--plugins"] if needs_permission(folder) else []
    words += [f"--{name}" for name, wanted in (("bound", options.bound), ("json", options.as_json)) if wanted]
    return shlex.join(words)


def _shard(text: str | None) -> Shard:
    if text is None:
        return WHOLE
    number, sign, count = text.partition("/")
    if not (sign and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise UsageError(f"--shard takes I/N with 1 <= I <= N, such as 1/2, not '{text}'")
    return Shard(int(number), int(count))
