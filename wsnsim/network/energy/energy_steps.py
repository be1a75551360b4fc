"""What the network spends in each step, by cause: the table `energy_steps`."""

from __future__ import annotations

import numpy as np
import simpy

from wsnsim.base.ports import Recorder
from wsnsim.network.nodes import Nodes


class EnergySteps:
    """The fleet's totals, cut at the ends of steps."""

    def __init__(self, env: simpy.Environment, fleet: Nodes, recorder: Recorder) -> None:
        self._wanted = recorder.wants("energy_steps")
        self._env = env
        self._fleet = fleet
        self._totals: list[list[float]] = [fleet.totals_now()[:]]
        self._steps: list[int] = []
        self._times: list[float] = [env.now]

    def close(self, step: int) -> None:
        """Note what has been spent until now: what was spent since the last call are the costs of this step."""
        if not self._wanted:
            return
        self._totals.append(self._fleet.totals_now()[:])
        self._steps.append(step)
        self._times.append(self._env.now)

    def end(self, step: int) -> None:
        """Settle the fleet, and close the last step."""
        if self._wanted:
            scheduled = self._fleet.scheduled_totals(np.array(self._times))
            self._totals = (np.array(self._totals) + scheduled).tolist()
        self._fleet.close()
        self.close(step)

    def write(self, replicate: int, dt: float, recorder: Recorder) -> None:
        """Write the table, if it is wanted. Rows of zero are left out."""
        if not self._wanted:
            return
        spent = np.diff(np.array(self._totals), axis=0)
        rows, causes = np.nonzero(spent)
        if rows.size:
            steps = np.array(self._steps)[rows]
            columns = {"step": steps, "time": steps * dt, "cause": causes, "joules": spent[rows, causes]}
            recorder.write("energy_steps", {"replicate": replicate, **columns})
