"""Open clusters: one fixed head, to which every node belongs that senses the target. Our choice, for comparison."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

import numpy as np
import simpy

from wsnsim.base.vector_readings import Reading
from wsnsim.network.clusters.cluster import Cluster, OpenCluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.handover import Handover
from wsnsim.network.clusters.standing_cluster import StandingClusterProtocol
from wsnsim.network.clusters.track import Track


class OpenClusterProtocol(StandingClusterProtocol):
    """The policy's `successor` names the head, at the start and after its death; there are no joins or elections."""

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Appoint the head that the policy names, once some node senses the target."""
        network, step = self._network, self._network.clock.step
        head = self._setup.clusters.successor(np.zeros(2), network.nodes.assumed.positions, network.who_can_lead())
        if head is None or not (network.readings[track.target] or step == 0):
            return None
        return Handover(head, step, readings={}, elected=True, at_once=True)

    def release(self, track: Track, cluster: Cluster) -> None:
        """Do nothing: members have no role."""

    def _form(self, track: Track, handover: Handover) -> Generator[simpy.Event, Any, Cluster | Handover]:
        """A cluster that costs no frame."""
        yield from ()
        cluster = OpenCluster(self._network, track.target, handover.successor, [])
        self._open(track, cluster, handover)
        return cluster

    def _known_readings(
        self, track: Track, head: int, readings: Mapping[int, Reading]
    ) -> Generator[simpy.Event, Any, Mapping[int, Reading]]:
        """The readings of all nodes that sense, sent to the head."""
        return (yield from self._services.messages.readings_of_everyone(track.target, head))

    def _driver(self, track: Track, cluster: Cluster) -> Driver:
        """Members may be anywhere: routing decides every path."""
        return Driver(self._services.driver, track.target, cluster.head, cluster.members, one_hop=False)

    def _waits_for(self, track: Track, cluster: Cluster) -> set[int] | None:
        """None: an open cluster is never too small."""
        return None
