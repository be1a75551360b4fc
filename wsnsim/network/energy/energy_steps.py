"""The table `energy_steps`: what the network spends in each step, by cause."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Recorder


class Spenders(Protocol):
    """The nodes, as far as the table needs them: see `network.nodes.Nodes`."""

    def totals_now(self) -> list[float]:
        """Joules by cause, summed over the nodes, now."""
        ...

    def scheduled_totals(self, times: Floats) -> Floats:
        """Joules that follow from the schedules alone, at these times."""
        ...

    def close(self) -> None:
        """Book what is pending."""
        ...


class EnergySteps:
    """The network's totals at the ends of steps, from which the rows of the table are computed."""

    def __init__(self, env: simpy.Environment, nodes: Spenders, recorder: Recorder) -> None:
        self._wanted = recorder.wants("energy_steps")
        self._env = env
        self._nodes = nodes
        self._totals: list[list[float]] = [nodes.totals_now()[:]]
        self._steps: list[int] = []
        self._times: list[float] = [env.now]

    def close(self, step: int) -> None:
        """Attribute to a step what was spent since the last call."""
        if not self._wanted:
            return
        self._totals.append(self._nodes.totals_now()[:])
        self._steps.append(step)
        self._times.append(self._env.now)

    def end(self, step: int) -> None:
        """Settle all nodes, and close the last step."""
        if self._wanted:
            scheduled = self._nodes.scheduled_totals(np.array(self._times))
            self._totals = (np.array(self._totals) + scheduled).tolist()
        self._nodes.close()
        self.close(step)

    def write(self, replicate: int, dt: float, recorder: Recorder) -> None:
        """Write the table if it is wanted. Rows of zero are left out."""
        if not self._wanted:
            return
        spent = np.diff(_rising(np.array(self._totals)), axis=0)
        rows, causes = np.nonzero(spent)
        if rows.size:
            steps = np.array(self._steps)[rows]
            columns = {"step": steps, "time": steps * dt, "cause": causes, "joules": spent[rows, causes]}
            recorder.write("energy_steps", {"replicate": replicate, **columns})


def _rising(totals: Floats) -> Floats:
    """(T, causes) totals that never fall and end as given.

    They fall where a frame under way, during which its radio is not idle, is subtracted before its time has passed, and
    where rounding does so: the next steps are then less.
    """
    rising: Floats = np.minimum(np.maximum.accumulate(totals, axis=0), totals[-1])
    return rising
