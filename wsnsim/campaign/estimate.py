"""What a campaign would take: tasks, time and size, from what is on disk, or from a trial of some of its points.

estimate(plan, folder, workers) -> Estimate
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import numpy as np

from wsnsim.campaign.drive import ALL, Part
from wsnsim.experiment import Progress, run
from wsnsim.recording import read_table
from wsnsim.recording.folder import Folder, runs_of
from wsnsim.scenario import load
from wsnsim.scenario.sweep_schema import Plan, Point

TRIALS: Final = 3
PATIENCE: Final = 10.0
"""s: after which a trial is cut short, and the rest reckoned from how far it came."""
QUICK: Final = 10.0
"""s: what a block may take that is run whole, so that what only the first replicate pays counts for little."""


@dataclass(frozen=True)
class Estimate:
    """Replicates in all, done and left; tasks; seconds of one worker and of `workers`; bytes; and from what it is."""

    points: int
    replicates: int
    done: int
    left: int
    tasks: int
    cpu_seconds: float
    wall_seconds: float
    size: float
    source: str


class _Enough(BaseException):  # an Exception would be taken for a failed run's
    """The trial has run long enough; `share` of it is done."""

    def __init__(self, share: float) -> None:
        super().__init__(share)
        self.share = share


def estimate(plan: Plan, folder: Folder, workers: int, part: Part = ALL) -> Estimate:
    """What is left of a part of a campaign, and what it would take. Writes nothing where the campaign is.

    With a stopping rule, of the replicates before it is asked first.
    """
    count = plan.until.at_least if plan.until else plan.replicates
    block = folder.manifest().block if folder.holds_campaign() else plan.block
    wanted = {
        point.id: [n for n in range(count) if part.has(place, 0 if plan.until else n // block)]
        for place, point in enumerate(plan.points)
    }
    missing = {point: sorted(set(numbers) - folder.done(point)) for point, numbers in wanted.items()}
    left = sum(map(len, missing.values()))
    tasks = sum(1 for numbers in missing.values() for _ in runs_of(numbers, block))
    seconds, size, source = _measured(plan, folder) if left else (0.0, 0.0, "nothing is left")
    total = sum(map(len, wanted.values()))
    cpu = seconds * left
    return Estimate(
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


def _measured(plan: Plan, folder: Folder) -> tuple[float, float, str]:
    """(seconds of a replicate, bytes of a file), and from what: results that are there, or trials of some points."""
    there = [batch for point in plan.points for batch in folder.batches(point.id)][:20]
    if there:
        seconds = [read_table(batch.path, "runs", ["cpu_seconds"])["cpu_seconds"].mean() for batch in there]
        sizes = [batch.path.stat().st_size for batch in there]
        return float(np.mean(seconds)), float(np.mean(sizes)), f"{len(there)} files that are there"
    chosen = _spread_over(plan.points)
    trials = [_trial(point, plan.block) for point in chosen]
    seconds, size = ([trial[i] for trial in trials] for i in (0, 1))
    many = f"one replicate at {len(chosen)} of the points" if len(chosen) > 1 else "one replicate"
    return float(np.mean(seconds)), float(np.mean(size)), f"{many}, run for it"


def _spread_over(points: Sequence[Point]) -> list[Point]:
    places = np.unique(np.linspace(0, len(points) - 1, min(TRIALS, len(points))).astype(int))
    return [points[int(place)] for place in places]


def _trial(point: Point, block: int) -> tuple[float, float]:
    """(seconds, bytes) of one replicate, run here and thrown away; of a whole block, if that is quickly done."""
    loaded: Any = load(json.loads(point.resolved))
    began = time.monotonic()

    def watch(progress: Progress) -> None:
        if progress.wall > PATIENCE and progress.time > 0.0:
            raise _Enough(progress.time / progress.duration)

    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "trial.h5"
        try:
            report = run(loaded, replicates=1, out=file, progress=watch)
        except _Enough as cut:
            return (time.monotonic() - began) / cut.share, float("nan")
        if report.summaries[0].run["cpu_seconds"] < QUICK / block:
            report = run(loaded, replicates=block, out=file)
        count = len(report.summaries)
        return fmean(summary.run["cpu_seconds"] for summary in report.summaries), file.stat().st_size / count
