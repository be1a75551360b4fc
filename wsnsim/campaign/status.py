"""Shards, progress and outcome of a campaign, which the runner is given or reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple


class Shard(NamedTuple):
    """One of `total` parts of a campaign, `number` counted from 1."""

    number: int
    total: int

    def has(self, point: int, block: int) -> bool:
        """Whether a block of a point belongs to this shard; both are counted from 0."""
        return (point + block) % self.total == self.number - 1


WHOLE: Final = Shard(1, 1)
"""The only shard of a campaign that is not divided."""


@dataclass(frozen=True, slots=True)
class CampaignProgress:
    """Progress of one session of a campaign.

    Attributes:
        done: replicates on disk, those of earlier sessions included.
        failed: tasks that failed.
        total: all replicates of the shard.
        wall: seconds since the session started.
        left: estimated seconds until the end, None while there is no estimate.
    """

    done: int
    failed: int
    total: int
    wall: float
    left: float | None


@dataclass(frozen=True)
class CampaignOutcome:
    """Outcome of one session of a campaign.

    Attributes:
        done: replicates computed in this session.
        found: replicates that were on disk before.
        failed: {task: reason}; also {point: reason} if a result file of a point cannot be read.
        missing: {point: replicates that are not on disk}.
        stopped: why the session stopped early, '' if it tried every task.
        seconds: duration of the session (s).
        left_out: {worker: why} of workers that joined and could not run the campaign.
    """

    done: int
    found: int
    failed: Mapping[str, str]
    missing: Mapping[str, list[int]]
    stopped: str
    seconds: float
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every replicate of the shard is on disk and nothing failed."""
        return not self.missing and not self.failed
