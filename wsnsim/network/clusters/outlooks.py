"""What heads foresee, put together for cluster policies that see the geometry.

outlooks.of_belief(track.target, cluster, belief, scene) -> Outlook      outlooks.of_estimate(...) -> Outlook
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.clustering import NearNodes, Outlook
from wsnsim.base.estimate import Estimate
from wsnsim.base.ports import ForecastsSuccession, MotionModel, Scene
from wsnsim.network.clusters.network_view import NetworkView


@dataclass(frozen=True, slots=True)
class NodesOnMap:
    """Finds nodes near a point on the map that every head has; it does not tell who is down, but who can lead."""

    network: NetworkView

    def __call__(self, point: Floats, radius: float) -> NearNodes:
        """The nodes whose assumed position is within a radius in m of a point (2,)."""
        network, nodes = self.network, self.network.nodes
        ids = nodes.assumed.grid.within(point, radius)
        able = np.array([network.can_lead(node) for node in ids.tolist()], dtype=np.bool_)
        return NearNodes(ids, nodes.assumed.positions[ids], nodes.traits[ids], able)


class Outlooks:
    """Puts outlooks together."""

    def __init__(self, network: NetworkView) -> None:
        self._network = network
        self._nodes_near = NodesOnMap(network)
        self._forecasts_succession = isinstance(network.setup.tracker, ForecastsSuccession)

    def of_belief(self, target: int, head: int, members: Sequence[int], belief: Any, scene: Scene) -> Outlook:
        """What a head foresees that holds a belief of the time of `scene`."""
        setup, ahead = self._network.setup, self._network.clock.step - scene.step + 1
        succession = forecast = setup.tracker.forecast(belief, scene, ahead)
        if self._forecasts_succession:
            succession = setup.successor_forecast(belief, scene, ahead)
        return self._outlook(target, head, members, forecast, succession)

    def of_estimate(self, target: int, head: int, estimate: Estimate) -> Outlook:
        """What a head foresees that knows the first estimate of a track, of this step."""
        network = self._network
        clock, motion = network.clock, network.setup.filter_motions[target]
        forecast = _one_step_on(estimate, motion, clock.dt, clock.step * clock.dt)
        return self._outlook(target, head, [head], forecast, forecast)

    def _outlook(
        self, target: int, head: int, members: Sequence[int], forecast: Estimate, succession: Estimate
    ) -> Outlook:
        network = self._network
        setup, clock, nodes = network.setup, network.clock, network.nodes
        return Outlook(
            head=head,
            place=nodes.assumed.positions[head],
            members=np.array(members, dtype=np.int64),
            time=clock.next_step,
            dt=clock.dt,
            forecast=forecast,
            succession=succession,
            motion=setup.filter_motions[target],
            sensor=setup.filter_sensor,
            reach=nodes.reach,
            nodes_near=self._nodes_near,
        )


def _one_step_on(estimate: Estimate, motion: MotionModel, dt: float, time: float) -> Estimate:
    """An estimate of `time` s, predicted for the step after it."""
    point = np.ascontiguousarray(estimate.mean[:, None])
    transitions, noise = motion.matrices(point, dt, time)
    cov = transitions[0] @ estimate.cov @ transitions[0].T + noise
    return Estimate(motion.advance(point, dt, time)[:, 0], 0.5 * (cov + cov.T))
