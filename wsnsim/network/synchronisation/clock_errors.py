"""The table `clocks`: how wrong the clocks of nodes are at each step, and how much they differ."""

from __future__ import annotations

import numpy as np

from wsnsim.base.ports import Recorder
from wsnsim.base.synchronisation import SyncMechanism
from wsnsim.network.clocks import Clocks
from wsnsim.network.nodes import Nodes

COLUMNS = ("step", "time", "error", "error_max", "spread", "spread_max", "synchronised")


class ClockErrors:
    """The errors of clocks at the beginnings of steps, from which the rows of the table are made."""

    def __init__(self, clocks: Clocks, nodes: Nodes, sync: SyncMechanism, recorder: Recorder) -> None:
        self._wanted = recorder.wants("clocks")
        self._clocks, self._nodes, self._sync = clocks, nodes, sync
        self._rows: list[tuple[float, ...]] = []

    def note(self, step: int, now: float) -> None:
        """Note the errors of the nodes that are up, at the beginning of a step."""
        if not self._wanted or not self._nodes.living.any():
            return
        up = np.flatnonzero(self._nodes.living)
        errors = self._clocks.error(up, now)
        sizes, spreads = np.abs(errors), np.abs(errors - errors.mean())
        synchronised = sum(map(self._sync.is_synchronised, up.tolist())) / len(up)
        self._rows.append((step, now, sizes.mean(), sizes.max(), spreads.mean(), spreads.max(), synchronised))

    def write(self, replicate: int, recorder: Recorder) -> None:
        """Write the table if it is wanted."""
        if self._rows:
            columns = dict(zip(COLUMNS, np.array(self._rows).T, strict=True))
            recorder.write("clocks", {"replicate": replicate, **columns})
