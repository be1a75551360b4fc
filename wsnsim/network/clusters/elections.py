"""Holds elections among the nodes that sense a target.

elections.fill_vacancy(track)      winner = yield from elections.vote(track)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Reading
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.network.clusters.collection import Deadline
from wsnsim.network.clusters.election import Election, waiting_share
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Handover, Track
from wsnsim.network.event_log import Acting, then
from wsnsim.network.node_process import NodeProcesses
from wsnsim.network.radio.transport import Transport

ELECTION_KEY: Final = 7
"""Makes the key of candidates' waits another than those of trackers."""


@dataclass(frozen=True, slots=True)
class Elections:
    """Holds elections. `appoint(track, handover)` gives a track that has no head to the winner."""

    network: NetworkView
    transport: Transport
    processes: NodeProcesses
    appoint: Callable[[Track, Handover], None]

    def fill_vacancy(self, track: Track, candidates: Mapping[int, Reading] | None = None) -> None:
        """Hold an election whose winner becomes head by itself; none where no node can be a candidate.

        Args:
            track: The track, or a group of them.
            candidates: {node: reading} of the candidates; None: those that sense the target.
        """
        self._hold(track, fills_vacancy=True, candidates=candidates)

    def vote(self, track: Track) -> Acting[int | None]:
        """Hold a network-wide election for a head that waits for it; the winner, or None where no node can lead."""
        election = self._hold(track, fills_vacancy=False)
        if election is None:
            return None
        winner: int | None = yield election.closed
        if winner is not None:
            self.network.log.add("elect", track.target, winner)
        return winner

    def _hold(
        self, track: Track, fills_vacancy: bool, candidates: Mapping[int, Reading] | None = None
    ) -> Election | None:
        """Start an election among candidates, by default the nodes that sense the target now, that can lead."""
        network = self.network
        sensing = network.readings[track.target] if candidates is None else candidates
        strengths = {node: reading for node, reading in sensing.items() if network.can_lead(node)}
        if not strengths:
            return None
        setup, clock = network.setup, network.clock
        election = Election(clock.env.event(), clock.step, strengths, setup.clusters, setup.sensor)
        track.election = election
        then(election.closed, setattr, track, "election", None)
        if setup.waits.closing is not None:
            then(Deadline(clock.env, setup.waits.closing), election.close)
        for node in strengths:
            self.processes.of(node).begin(self._stand(track, election, node, fills_vacancy))
        return election

    def _stand(self, track: Track, election: Election, node: int, fills_vacancy: bool) -> Acting[None]:
        """A candidate's part: broadcast its strength, unless it has heard that another's is at least as great.

        The winner of an election that fills a vacancy takes the lead.
        """
        parcel = Parcel(election.readings[node], 1, PACKET_BITS, "strength")
        try:
            if (yield from self._keeps_silent(track, election, node)):
                election.withdraw(node)
            elif not election.closed.triggered:
                event, (burst,) = self.transport.broadcast([node], [parcel], track.target)
                yield event
                election.report(node, burst.received)
            winner = yield election.closed
        except simpy.Interrupt:
            return
        if winner == node and fills_vacancy and self.network.nodes.alive[node]:
            self.network.log.add("elect", track.target, node)
            readings = election.readings_at(node)
            self.appoint(track, Handover(node, election.step, readings=readings, elected=True, acts_now=True))

    def _keeps_silent(self, track: Track, election: Election, node: int) -> Acting[bool]:
        """Where broadcasts take long, wait: the nearer the target, the shorter. Whether nothing is left to say then."""
        network, setup = self.network, self.network.setup
        if setup.waits.election is None:
            return False
        key = derive(network.tracker_key, ELECTION_KEY, track.target, election.step)
        chance = float(uniforms(derive_all(key, np.array([node])), 0)[0])
        columns, traits = len(setup.filter_motion(track.target).position), network.nodes.traits[node]
        share = waiting_share(setup.filter_sensor, columns, traits, election.readings[node], chance)
        yield network.clock.env.timeout(share * setup.waits.election)
        return election.is_outbid(node)
