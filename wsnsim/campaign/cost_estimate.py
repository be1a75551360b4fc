"""The estimated cost of a campaign: tasks, time and size, from its results or from trial runs of some points."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Final

import numpy as np

import wsnsim.experiment as experiment
import wsnsim.scenario as scenario
from wsnsim.campaign.engines import WHOLE, Shard
from wsnsim.recording import read_table
from wsnsim.recording.folder import Folder, consecutive
from wsnsim.scenario.sweep_schema import Plan, Point

MAX_TRIALS: Final = 3
MAX_SAMPLES: Final = 20
"""Result files from which the cost is estimated."""
TRIAL_TIMEOUT: Final = 10.0
"""Seconds after which a trial is cut short and extrapolated."""
BLOCK_TIME: Final = 10.0
"""If a block takes fewer seconds, the whole block is run, so that one-time costs of its first replicate weigh less."""


@dataclass(frozen=True)
class CostEstimate:
    """The estimated cost of what is missing of a shard.

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
    """The estimated cost of what is missing of a shard. Nothing is written to the campaign's folder.

    `batch` says whether standalone runs may be made many at once.
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
    seconds, size, source = _unit_cost(plan, folder, batch) if left else (0.0, 0.0, "nothing is missing")
    total = sum(map(len, wanted.values()))
    cpu = seconds * left
    return CostEstimate(
        points=len(plan.points),
        replicates=total,
        done=total - left,
        left=left,
        tasks=tasks,
        cpu_seconds=cpu,
        wall_seconds=cpu / max(1, min(workers, tasks)) if tasks else 0.0,
        size=size * tasks,
        source=source,
    )


def _unit_cost(plan: Plan, folder: Folder, batch: bool) -> tuple[float, float, str]:
    """(seconds per replicate, bytes per file, source), from existing results or from trials of some points."""
    files = [batch.path for point in plan.points for batch in folder.batches(point.id)][:MAX_SAMPLES]
    if files:
        seconds = [read_table(file, "runs", ["cpu_seconds"])["cpu_seconds"].mean() for file in files]
        return float(np.mean(seconds)), fmean(file.stat().st_size for file in files), f"{len(files)} existing files"
    chosen = _spread_over(plan.points)
    trials = [_trial(point, plan.block, batch) for point in chosen]
    seconds, size = ([trial[i] for trial in trials] for i in (0, 1))
    source = f"trial runs at {len(chosen)} points" if len(chosen) > 1 else "one trial run"
    return float(np.mean(seconds)), float(np.mean(size)), source


def _spread_over(points: Sequence[Point]) -> list[Point]:
    """A few points, evenly spread."""
    chosen = np.unique(np.linspace(0, len(points) - 1, min(MAX_TRIALS, len(points))).astype(int))
    return [points[int(i)] for i in chosen]


def _trial(point: Point, block: int, batch: bool) -> tuple[float, float]:
    """(seconds, bytes) of one replicate, or the mean of a whole block if that is fast. The result is not kept."""
    loaded = scenario.load(json.loads(point.resolved))
    started_at = time.monotonic()

    def cut_if_long(progress: experiment.Progress) -> None:
        if progress.wall > TRIAL_TIMEOUT and 0.0 < progress.time < progress.duration:
            raise _TrialCut(progress.time / progress.duration)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "trial.h5"
        try:
            report = experiment.run(loaded, replicates=1, out=file, progress=cut_if_long)
        except _TrialCut as cut:
            return (time.monotonic() - started_at) / cut.share, float("nan")
        if report.summaries[0].run["cpu_seconds"] < BLOCK_TIME / block:
            report = experiment.run(loaded, replicates=block, out=file, batch=batch)
        count = len(report.summaries)
        return fmean(summary.run["cpu_seconds"] for summary in report.summaries), file.stat().st_size / count
