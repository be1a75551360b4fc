"""How far a campaign is, read from its folder: runs, failures, running tasks and the processor time of runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from wsnsim.analysis import campaigns
from wsnsim.analysis.baselines import label
from wsnsim.analysis.stopping import ReplicateCounts
from wsnsim.base.errors import ResultError
from wsnsim.recording.folder import Folder

MOST_POINTS: Final = 300
"""Points, and failures, that are listed (our choice)."""


@dataclass(frozen=True)
class PointState:
    """One point: its settings, runs on disk, failed and wanted, and the median processor time of a run (s)."""

    settings: str
    done: int
    failed: int
    wanted: int
    seconds: float | None = None


@dataclass(frozen=True)
class CampaignState:
    """A campaign as it is on disk.

    Attributes:
        name: its name.
        points: its points, at most `MOST_POINTS`.
        done: runs on disk, `failed` those that failed, of `total`.
        running: tasks that a process has begun and not finished.
        failures: {task: first line of the reason}, at most `MOST_POINTS`.
    """

    name: str
    points: tuple[PointState, ...]
    done: int
    failed: int
    total: int
    running: int
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether each run is on disk or has failed."""
        return self.done + self.failed >= self.total

    def text(self) -> str:
        """One line."""
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.total} runs done{failed}, at {len(self.points)} points"


def campaign_state(folder: Folder) -> CampaignState:
    """The state of a campaign.

    Raises:
        ResultError: the folder cannot be read.
    """
    manifest = folder.manifest()
    rule, seconds = ReplicateCounts(folder, manifest), _seconds(folder)
    points = []
    for number, point in enumerate(manifest.points):
        wanted, done, failed = rule.wanted(point), folder.done(point.id), folder.given_up(point.id)
        settings = ", ".join(f"{key} = {label([value])}" for key, value in point.settings.items())
        found, lost = (sum(run < wanted for run in runs) for runs in (done, failed))
        points.append(PointState(settings or "the scenario unchanged", found, lost, wanted, seconds.get(number)))
    reasons = list(folder.failures().items())[:MOST_POINTS]
    return CampaignState(
        name=manifest.name,
        points=tuple(points[:MOST_POINTS]),
        done=sum(point.done for point in points),
        failed=sum(point.failed for point in points),
        total=sum(point.wanted for point in points),
        running=sum(1 for _ in folder.path.glob("running/*.log")),
        failures={task: (why.splitlines() or [""])[0] for task, why in reasons},
    )


def _seconds(folder: Folder) -> dict[int, Any]:
    """{number of a point: median processor time of its runs in s}, of the points with results."""
    try:
        runs = campaigns.read(folder.path, "runs", ["cpu_seconds"])
    except ResultError:  # no results yet, or a file that is just being written
        return {}
    medians = runs.groupby(campaigns.POINT)["cpu_seconds"].median()
    return {int(point): float(value) for point, value in medians.items() if np.isfinite(value)}
