"""When a point has replicates enough: a fixed number, or until the median of a metric is known well enough."""

from __future__ import annotations

from typing import final

import numpy as np

from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.scenario.sweep_schema import StoppingRule


@final
class Rule:
    """Asked at a number of replicates, says how many there are to be."""

    def __init__(self, folder: Folder, manifest: Manifest) -> None:
        self._folder = folder
        self._rule = StoppingRule.model_validate(manifest.until) if manifest.until else None

    def first(self, point: PointOnDisk) -> int:
        """How many replicates the point has before anybody asks."""
        return self._rule.at_least if self._rule else point.replicates

    def next(self, point: str, replicates: int) -> int:
        """How many replicates the point is to have, now that it has this many: as many if that is enough."""
        if self._rule is None or replicates >= self._rule.at_most:
            return replicates
        from wsnsim.analysis import campaigns, statistics  # pandas, which workers do without

        values = campaigns.metric(self._folder, point, self._rule.metric, replicates)
        middle = float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
        low, high = statistics.interval_of_median(values)
        known = 0.5 * (high - low) <= self._rule.half_width * abs(middle)
        return replicates if known else self._rule.next_look(replicates)
