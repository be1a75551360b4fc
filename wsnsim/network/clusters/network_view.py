"""What heads and clusters use of the network: setup, time, log, nodes, and the readings of each target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wsnsim.base.arrays import Bools, Floats, planar
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.vector_readings import Reading
from wsnsim.network.nodes import Nodes
from wsnsim.network.step_clock import ProtocolLog, StepClock


@dataclass(frozen=True, slots=True)
class NetworkView:
    """The network as heads and clusters see it. Through this view they log events, but change nothing else.

    `readings[target]` is {node: reading} of the living nodes that sense a target now. A head must hold more than
    `threshold` joules. `tracker_key` is the counter key of the trackers' random numbers.
    """

    setup: NetworkSetup
    clock: StepClock
    log: ProtocolLog
    nodes: Nodes
    readings: Sequence[Mapping[int, Reading]]
    threshold: float
    tracker_key: int

    def can_lead(self, node: int) -> bool:
        """Whether a node is up and holds more than the threshold (Jiang 2013, section 4, step 2)."""
        return self.nodes.alive[node] and self.nodes.holds_more(node, self.threshold)

    def who_can_lead(self) -> Bools:
        """(N,) the same of every node."""
        return self.nodes.able(self.threshold)

    def predicted_position(self, target: int, belief: Any, scene: Scene) -> Floats:
        """(2,) the position that a belief predicts for the next step: where nodes are woken."""
        return self._position(target, self.setup.tracker.forecast(belief, scene, self._ahead(scene)))

    def successor_position(self, target: int, belief: Any, scene: Scene) -> Floats:
        """(2,) the position near which the next head is looked for; see `ForecastsSuccession`."""
        return self._position(target, self.setup.successor_forecast(belief, scene, self._ahead(scene)))

    def _ahead(self, scene: Scene) -> int:
        """The steps from a scene to the next step."""
        return self.clock.step - scene.step + 1

    def _position(self, target: int, forecast: Estimate) -> Floats:
        return planar(forecast.mean[list(self.setup.filter_motions[target].position)])

    def nearest(self, candidates: Sequence[int], point: Floats) -> int:
        """The candidate assumed nearest to a point (2,); of equally near ones the first."""
        away = ((self.nodes.assumed.positions[np.array(candidates)] - point) ** 2).sum(axis=1)
        return candidates[int(np.argmin(away))]
