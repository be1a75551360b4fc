"""How many runs a point of a campaign gets: a fixed number, or until the median of a metric is precise enough."""

from __future__ import annotations

import time
from collections.abc import Set
from typing import Final, final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.scenario.sweep_schema import StoppingRule

PATIENCE: Final = 60.0
"""Seconds to wait for a file that another machine wrote; network file systems may take tens of seconds."""
POLL: Final = 0.5
"""Seconds between two looks for it."""


@final
class ReplicateCounts:
    """The number of runs that each point is to have, from the files on disk alone."""

    def __init__(self, folder: Folder, manifest: Manifest) -> None:
        self._folder = folder
        self._rule = StoppingRule.model_validate(manifest.until) if manifest.until else None

    def first(self, point: PointOnDisk) -> int:
        """The number of runs before the first decision."""
        return self._rule.at_least if self._rule else point.replicates

    def next(self, point: str, replicates: int) -> int:
        """The number of runs that the point is to have, given that it has `replicates`; the same number is enough.

        Runs that failed do not count. If they are more than half, the number is enough: the rest would fail as well.

        Raises:
            ResultError: a run cannot be read.
        """
        if self._rule is None or replicates >= self._rule.at_most:
            return replicates
        failed = {number for number in self._folder.given_up(point) if number < replicates}
        if 2 * len(failed) > replicates:
            return replicates
        from wsnsim.analysis import statistics  # slow to import, and only a rule needs it

        values = self._values(point, replicates, failed)
        middle = float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
        low, high = statistics.interval_of_median(values)
        known = 0.5 * (high - low) <= self._rule.half_width * abs(middle)
        return replicates if known else self._rule.next_look(replicates)

    def wanted(self, point: PointOnDisk) -> int:
        """The number of runs that the point is to have, as far as the files on disk decide it."""
        target = self.first(point)
        while self._folder.given_up(point.id).issuperset(self._folder.missing(point.id, target)):
            more = self.next(point.id, target)
            if more == target:
                break
            target = more
        return target

    def missing(self, point: PointOnDisk) -> list[int]:
        """The numbers of the runs that are missing on disk."""
        return self._folder.missing(point.id, self.wanted(point))

    def _values(self, point: str, replicates: int, failed: Set[int]) -> Floats:
        """The metric of every run that did not fail, once all of their files are visible."""
        from wsnsim.analysis import campaigns  # as above

        assert self._rule is not None
        until = time.monotonic() + PATIENCE
        counted = np.array([number not in failed for number in range(replicates)])
        while True:
            values, seen = campaigns.metric(self._folder, point, self._rule.metric, replicates)
            if seen[counted].all():
                return np.asarray(values[counted])
            if time.monotonic() > until:
                raise ResultError(
                    f"{self._folder.path / point}: replicate {int(np.argmax(counted & ~seen))} is missing"
                )
            time.sleep(POLL)
