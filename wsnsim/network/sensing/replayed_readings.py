"""The readings of one target that were recorded: what each node has at each step is in a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.ports import Recording
from wsnsim.base.vector_readings import Reading
from wsnsim.network.sensing.readings import Readings
from wsnsim.network.sensing.reports import Reports


class ReplayedReadings(Readings):
    """Recorded readings as nodes report them: a node has one at a step if the recording has, wherever the target is.

    A fault of a sensor (`bias`, `stuck`) changes what is reported. Wrong clocks do not: the recording gives the times.

    Args:
        recording: The readings of the target.
        defects: The sensor defects of this instant, by fault number.
    """

    def __init__(self, recording: Recording, defects: Mapping[int, SensorDefect]) -> None:
        self._recorded = recording.readings
        self._reports = Reports(self._take, defects)

    def readings(self, step: int) -> dict[int, Reading]:
        """{node: reading} of the nodes that have one at a step, ascending, whether they are up or not."""
        return dict(self._reports.at(step))

    def _ids_at(self, step: int) -> Iterable[int]:
        return self._reports.at(step)

    def _take(self, step: int) -> dict[int, Reading]:
        row = self._recorded[step]
        nodes = np.flatnonzero(np.isfinite(row))
        return dict(zip(nodes.tolist(), row[nodes].tolist(), strict=True))
