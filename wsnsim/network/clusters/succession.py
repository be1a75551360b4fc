"""Which node leads next where heads move: near the prediction, or the one that measured the target nearest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from wsnsim.base.ports import Scene
from wsnsim.base.vector_readings import Reading
from wsnsim.network.clusters.election import strength_of
from wsnsim.network.clusters.handover import TrackLost
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Track


@dataclass(slots=True)
class Lead:
    """One head's lead of a track.

    Attributes:
        belief_step: the step of the belief; `belief_time`: the time in s of the belief.
        last_sensed: time in s of the last measurement.
        scene: the scene of the last step; unset before the first.
        heard: {node: reading} of the last step.
    """

    track: Track
    head: int
    belief: Any
    belief_step: int
    belief_time: float
    last_sensed: float
    scene: Scene = field(init=False)
    heard: Mapping[int, Reading] = field(default_factory=dict)


class Succession(Protocol):
    """Who leads next."""

    def waker(self, lead: Lead) -> int:
        """The node that wakes others for the next step: it gets the belief at once, if it is not the head.

        Raises:
            TrackLost: there is no such node.
        """

    def head_at_step(self, lead: Lead) -> int:
        """The head at the step's instant, once nodes have been woken for it.

        Raises:
            TrackLost: no node that was woken can lead.
        """


@dataclass(frozen=True, slots=True)
class ByDetection:
    """The node that measured the target nearest at the last step; the head itself if no reading arrived."""

    network: NetworkView

    def waker(self, lead: Lead) -> int:
        """The node with the strongest reading; of equal ones the lowest id."""
        sensor = self.network.setup.sensor
        able = {node: reading for node, reading in lead.heard.items() if self.network.can_lead(node)}
        return min(able, key=lambda node: (-strength_of(sensor, able[node]), node), default=lead.head)

    def head_at_step(self, lead: Lead) -> int:
        """The head: it took over after the last step."""
        return lead.head


@dataclass(frozen=True, slots=True)
class ByPrediction:
    """The node nearest to the predicted position among those woken for the step; until then the head wakes them."""

    network: NetworkView

    def waker(self, lead: Lead) -> int:
        """The head."""
        return lead.head

    def head_at_step(self, lead: Lead) -> int:
        """The able node nearest to the predicted position; the head if no node was woken for this step."""
        round_ = lead.track.round
        if round_ is None or round_.message.step != self.network.clock.step:
            return lead.head
        able = [node for node in sorted(round_.tracking) if self.network.can_lead(node)]
        if not able:
            raise TrackLost("expired" if round_.expired else "nobody_woken")
        return self.network.nearest(able, np.array(round_.message.centre))


class ByAnnouncedPrediction(ByPrediction):
    """As `ByPrediction`, but the node nearest to the prediction gets the belief at once and wakes the others."""

    def waker(self, lead: Lead) -> int:
        """The able node nearest to the predicted position, within sensing range of it."""
        network = self.network
        point = network.successor_position(lead.track.target, lead.belief, lead.scene)
        near = network.nodes.assumed.grid.within(point, network.setup.sensor.reach)
        able = [node for node in near.tolist() if network.can_lead(node)]
        if not able:
            raise TrackLost("empty_region")
        return network.nearest(able, point)


def make_succession(network: NetworkView, main: str) -> Succession:
    """The rule of a policy whose `main` is 'prediction' or 'detection'."""
    if main == "detection":
        return ByDetection(network)
    return ByAnnouncedPrediction(network) if network.setup.wakeup.mechanism == "region" else ByPrediction(network)
