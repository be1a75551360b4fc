"""What runs a sweep, and its estimated cost: tasks, time and size, by its results or trial runs."""

from __future__ import annotations

import inspect
import json
import math
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np

import wsnsim.experiment as experiment
import wsnsim.scenario as scenario
from wsnsim.base.errors import RunError
from wsnsim.base.plugin_code import NOT_PYTHON, statements
from wsnsim.campaign import engines
from wsnsim.campaign.code_changes import code_id, code_of_plan
from wsnsim.campaign.engines import WHOLE, Shard
from wsnsim.campaign.task import COMMAND_LINE
from wsnsim.recording import read_table
from wsnsim.recording.folder import Folder, consecutive
from wsnsim.scenario.sweep_schema import Plan, Point


def needs_main_guard() -> bool:
    """Whether a script calls this function where a worker process that imports the script would call it, too."""
    frame = inspect.currentframe()
    while frame is not None:
        name, file = frame.f_globals.get("__name__"), frame.f_globals.get("__file__")
        if frame.f_code.co_name == "<module>" and (
            name == "__mp_main__" or (name == "__main__" and file and not is_guarded(_text(file), frame.f_lineno))
        ):
            return True
        frame = frame.f_back
    return False


def is_guarded(script: str, line: int) -> bool:
    """Whether a script tests `__name__` at or before a line, outside of functions; also if it cannot be read."""
    try:
        before = [tokens for tokens in statements(script.encode()) if tokens[0].start[0] <= line]
    except NOT_PYTHON:
        return True
    tests = [tokens for tokens in before if tokens[0].string == "if" and tokens[0].start[1] == 0]
    return any(token.string == "__name__" for test in tests for token in test)


def _text(file: str) -> str:
    try:
        return Path(file).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return "("  # not Python, which `is_guarded` takes for guarded


def engine_of(
    folder: Path, workers: int | None, scheduler: str | None, scheduler_file: Path | None = None
) -> engines.Engine:
    """The engine of a campaign: workers here, all cores by default, this process (0 workers), or a Dask scheduler."""
    if scheduler is not None or scheduler_file is not None:
        from wsnsim.campaign.dask_engine import DaskEngine

        return DaskEngine(folder, scheduler, scheduler_file)
    return engines.SerialEngine() if workers == 0 else engines.LocalEngine(workers or engines.available_cores())


MAX_TRIALS: Final = 3
"""Points at which trial runs are made."""
MAX_SAMPLES: Final = 20
"""Result files from which the cost is estimated."""
TRIAL_TIMEOUT: Final = 10.0
"""Seconds after which a trial is cut short and extrapolated."""
BLOCK_TIME: Final = 10.0
"""If a block takes fewer seconds, the whole block is run, so that one-time costs of its first replicate weigh less."""


@dataclass(frozen=True)
class CostEstimate:
    """The estimated cost of the missing runs of a shard.

    Attributes:
        points: number of points.
        replicates: replicates of the shard; with a stopping rule, those before its first decision.
        done: replicates on disk.
        left: missing replicates.
        tasks: tasks of the missing replicates.
        cpu_seconds: time on one worker (s).
        wall_seconds: time on all workers (s).
        size: size of the missing files (bytes), NaN if unknown.
        source: what the estimate is based on.
    """

    points: int
    replicates: int
    done: int
    left: int
    tasks: int
    cpu_seconds: float
    wall_seconds: float
    size: float
    source: str


class _TrialCut(BaseException):  # an Exception would be reported as a failed run
    """Ends a trial of which the fraction `share` is done."""

    def __init__(self, share: float) -> None:
        super().__init__(share)
        self.share = share


def estimate_cost(plan: Plan, folder: Folder, workers: int, shard: Shard = WHOLE, batch: bool = True) -> CostEstimate:
    """The estimated cost of the missing runs of a shard. Nothing is written to the campaign's folder.

    `batch` says whether many standalone runs may be computed at once.
    """
    count = plan.until.at_least if plan.until else plan.replicates
    block = folder.manifest().block if folder.holds_campaign() else plan.block
    wanted = {
        point.id: [n for n in range(count) if shard.has(position, 0 if plan.until else n // block)]
        for position, point in enumerate(plan.points)
    }
    missing = {point: sorted(set(numbers) - folder.done(point)) for point, numbers in wanted.items()}
    left = sum(map(len, missing.values()))
    tasks = sum(1 for numbers in missing.values() for _ in consecutive(numbers, block))
    cost, source = _unit_cost(plan, folder, batch) if left else (UnitCost(0.0, 0.0, 0.0), "nothing is missing")
    total = sum(map(len, wanted.values()))
    cpu = cost.seconds * left
    return CostEstimate(
        points=len(plan.points),
        replicates=total,
        done=total - left,
        left=left,
        tasks=tasks,
        cpu_seconds=cpu,
        wall_seconds=cpu / max(1, min(workers, tasks)) if tasks else 0.0,
        size=cost.first * tasks + cost.further * (left - tasks),
        source=source,
    )


class UnitCost(NamedTuple):
    """The CPU time of a run in s, and the bytes of the first run in a file and of a further one."""

    seconds: float
    first: float
    further: float


def _unit_cost(plan: Plan, folder: Folder, batch: bool) -> tuple[UnitCost, str]:
    """What a run costs, and the source: existing results, of which each run has its share, or trials of some points."""
    files = [batch.path for point in plan.points for batch in folder.batches(point.id)][:MAX_SAMPLES]
    if files:
        seconds = [read_table(file, "runs", ["cpu_seconds"])["cpu_seconds"] for file in files]
        share = fmean(file.stat().st_size / len(runs) for file, runs in zip(files, seconds, strict=True))
        return UnitCost(fmean(runs.mean() for runs in seconds), share, share), f"{len(files)} existing files"
    last = len(plan.points) - 1
    chosen = np.unique(np.linspace(0, last, min(MAX_TRIALS, last + 1)).astype(int)).tolist()  # evenly spread
    code = code_id(code_of_plan(plan))
    trials, failed = [], []
    for point in (plan.points[index] for index in chosen):
        try:
            trials.append(_trial(point, plan.block, batch, code))
        except RunError as error:
            settings = ", ".join(f"{key} = {value}" for key, value in point.settings.items())
            failed.append(f"{settings or point.id} failed: {error}")
    source = f"trial runs at {len(trials)} points" if len(trials) != 1 else "one trial run"
    if not trials:
        raise RunError(failed[0])
    return UnitCost(*np.mean(trials, axis=0).tolist()), "; ".join([source, *failed])


def _trial(point: Point, block: int, batch: bool, code: str) -> UnitCost:
    """What one replicate costs, or each of a block if that is fast. The results are not kept.

    Files have the provenance that a task writes: HDF5 allocates 4 KiB at a time, so a few bytes more can count as many.
    """
    loaded = scenario.load(json.loads(point.resolved))
    started_at = time.monotonic()

    def cut_if_long(progress: experiment.Progress) -> None:
        if progress.wall > TRIAL_TIMEOUT and 0.0 < progress.time < progress.duration:
            raise _TrialCut(progress.time / progress.duration)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "trial.h5"
        run = partial(experiment.run, loaded, out=file, command_line=COMMAND_LINE, code=code)
        try:
            report = run(replicates=1, progress=cut_if_long)
        except _TrialCut as cut:
            return UnitCost((time.monotonic() - started_at) / cut.share, math.nan, math.nan)
        first = further = float(file.stat().st_size)
        if report.summaries[0].run["cpu_seconds"] < BLOCK_TIME / block and block > 1:
            report = run(replicates=block, batch=batch)
            further = (file.stat().st_size - first) / (block - 1)
        return UnitCost(fmean(summary.run["cpu_seconds"] for summary in report.summaries), first, further)
