"""The protocol of cluster heads: how a track gets a head, and what a head does until the next one takes over."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Protocol

import simpy

from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import DriverServices
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.estimates import Estimates
from wsnsim.network.clusters.handover import Handover
from wsnsim.network.clusters.head_messages import HeadMessages
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.target_search import TargetSearch
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_ahead import WakesAhead
from wsnsim.network.node import NodeProcesses

Leading = Generator[simpy.Event, Any, Handover | None]
HandingOver = Generator[simpy.Event, Any, Handover]
Waiting = Generator[simpy.Event, Any, None]


@dataclass(frozen=True, slots=True)
class HeadServices:
    """What head protocols use."""

    network: NetworkView
    messages: HeadMessages
    driver: DriverServices
    elections: Elections
    estimates: Estimates
    wake_ahead: WakesAhead
    processes: NodeProcesses
    search: TargetSearch


class HeadProtocol(Protocol):
    """What the head of a track does. `ClusterCoordination` calls it, and appoints whom it names."""

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Name a head for a track that has none, or have one elected.

        Args:
            track: the track.
            poll: the number of the instant within the step, from 0.
        """

    def lead(self, track: Track, handover: Handover) -> Leading:
        """Lead a track from the handover on; return the next handover, None if another head leads already.

        Raises:
            TrackLost: the track has no belief any more. LastClusterDone: the run ends here.
        """

    def release(self, track: Track, cluster: Cluster) -> None:
        """Dismiss the members of a cluster that is dissolved."""
