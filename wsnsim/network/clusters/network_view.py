"""What heads and clusters read of the network: the setup, the time, the nodes and who senses which target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.setups import NetworkSetup
from wsnsim.network.nodes import Nodes
from wsnsim.network.step_clock import StepClock


@dataclass(frozen=True, slots=True)
class NetworkView:
    """The network as heads and clusters see it; none of it is changed through this view.

    `readings[target]` is {node: reading} of the living nodes that sense a target now. A head must hold more than
    `threshold` joules. `tracker_key` is the counter key of the trackers' random numbers.
    """

    setup: NetworkSetup
    clock: StepClock
    nodes: Nodes
    readings: Sequence[Mapping[int, float]]
    threshold: float
    tracker_key: int

    def can_lead(self, node: int) -> bool:
        """Whether a node is up and holds more than the threshold (Jiang 2013, section 4, step 2)."""
        return self.nodes.alive[node] and self.nodes.holds_more(node, self.threshold)

    def who_can_lead(self) -> Bools:
        """(N,) the same of every node."""
        return self.nodes.able(self.threshold)

    def nearest(self, candidates: Sequence[int], point: Floats) -> int:
        """The candidate nearest to a point (2,); of equally near ones the first."""
        away = ((self.nodes.positions[np.array(candidates)] - point) ** 2).sum(axis=1)
        return candidates[int(np.argmin(away))]
