"""What the network spends in each step, by cause: the table `energy_steps`."""

from __future__ import annotations

import numpy as np

from wsnsim.base.ports import Recorder
from wsnsim.network.fleet import Fleet


class StepCosts:
    """The fleet's totals, cut at the ends of steps."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._before = fleet.totals_now()[:]
        self._rows: list[tuple[int, int, float]] = []

    def close(self, step: int) -> None:
        """Note what has been spent since the last call: the costs of this step."""
        totals, before = self._fleet.totals_now()[:], self._before
        self._before = totals
        self._rows += [
            (step, cause, total - before[cause]) for cause, total in enumerate(totals) if total != before[cause]
        ]

    def write(self, replicate: int, dt: float, recorder: Recorder) -> None:
        """Write the table, if it is wanted."""
        if recorder.wants("energy_steps") and self._rows:
            steps, causes, joules = (np.array(column) for column in zip(*self._rows, strict=True))
            columns = {"step": steps, "time": steps * dt, "cause": causes, "joules": joules}
            recorder.write("energy_steps", {"replicate": replicate, **columns})
