"""Holds elections among the nodes that sense a target.

elections.fill_vacancy(track)      winner = yield from elections.vote(track)
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import simpy

from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.election import Election
from wsnsim.network.clusters.handover import Handover
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Track
from wsnsim.network.node import NodeProcesses
from wsnsim.network.radio.transport import Transport


@dataclass(frozen=True, slots=True)
class Elections:
    """Holds elections. `appoint(track, handover)` gives a track that has no head to the winner."""

    network: NetworkView
    transport: Transport
    processes: NodeProcesses
    appoint: Callable[[Track, Handover], None]

    def fill_vacancy(self, track: Track) -> None:
        """Hold an election whose winner becomes head by itself; none where no node can be a candidate."""
        self._hold(track, fills_vacancy=True)

    def vote(self, track: Track) -> Generator[simpy.Event, Any, int | None]:
        """Hold a network-wide election for a head that waits for it; the winner, or None where no node can lead."""
        election = self._hold(track, fills_vacancy=False)
        if election is None:
            return None
        winner: int | None = yield election.closed
        if winner is not None:
            self.network.log.add("elect", track.target, winner)
        return winner

    def _hold(self, track: Track, fills_vacancy: bool) -> Election | None:
        """Start an election among the nodes that sense the target now and can lead."""
        network = self.network
        strengths = {
            node: reading for node, reading in network.readings[track.target].items() if network.can_lead(node)
        }
        if not strengths:
            return None
        setup, clock = network.setup, network.clock
        election = Election(clock.env.event(), clock.step, strengths, setup.clusters, setup.sensor)
        track.election = election
        assert election.closed.callbacks is not None
        election.closed.callbacks.append(lambda _: setattr(track, "election", None))
        for node in strengths:
            self.processes.of(node).begin(self._stand(track, election, node, fills_vacancy))
        return election

    def _stand(
        self, track: Track, election: Election, node: int, fills_vacancy: bool
    ) -> Generator[simpy.Event, Any, None]:
        """A candidate's part: broadcast its strength; the winner of an election that fills a vacancy takes the lead."""
        parcel = Parcel(election.strengths[node], 1, PACKET_BITS, "strength")
        try:
            event, (burst,) = self.transport.broadcast([node], [parcel], track.target)
            yield event
            election.report(node, burst.received)
            winner = yield election.closed
        except simpy.Interrupt:
            return
        if winner == node and fills_vacancy and self.network.nodes.alive[node]:
            self.network.log.add("elect", track.target, node)
            readings = election.readings_at(node)
            self.appoint(track, Handover(node, election.step, readings=readings, elected=True, at_once=True))
