"""How a cluster comes to be: who joins, who is elected, and what a track starts from.

recruit(...) -> ids    vote(...) -> id or None    first_estimate(...) -> (Estimate, readings)
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np
import simpy

from wsnsim.base.ports import Estimate
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.driver import HeadDied
from wsnsim.network.clusters.handover import Crew, Handover, TrackLost
from wsnsim.network.clusters.track import Track, ballot_box
from wsnsim.network.radio.transport import Datagram
from wsnsim.network.run_context import RunContext


def recruit(stage: RunContext, track: Track, head: int) -> Generator[simpy.Event, Any, list[int]]:
    """One announcement at reach, one join from each sensing node that heard it; who joined, ascending."""
    target = track.target
    stage.log("announce", target, head)
    event, (frame,) = stage.air.broadcast([head], [Parcel(None, 1, PACKET_BITS, "announce")], target)
    yield event
    if not stage.fleet.alive[head]:
        raise HeadDied
    heard = [node for node in sorted(frame.received) if node in stage.sensing[target] and stage.fleet.alive[node]]
    letters = [Datagram(node, head, Parcel(None, 1, PACKET_BITS, "join")) for node in heard]
    if letters:
        yield stage.air.carry(letters, target)
    if not stage.fleet.alive[head]:
        raise HeadDied
    joined = [item.source for item in letters if item.arrived and stage.fleet.alive[item.source]]
    for node in joined:
        stage.log("join", target, node, peer=head)
    return joined


def vote(stage: RunContext, crew: Crew, track: Track) -> Generator[simpy.Event, Any, int | None]:
    """A network-wide election; the winner, or None where nobody is able."""
    election = ballot_box(stage, track, fills_vacancy=False)
    if not election.strengths:
        return None
    crew.call_election(track, election)
    winner: int | None = yield election.closed
    if winner is not None:
        stage.log("elect", track.target, winner)
    return winner


def first_estimate(
    stage: RunContext, track: Track, head: int, mission: Handover
) -> Generator[simpy.Event, Any, tuple[Estimate, int]]:
    """What a new track starts from, and of how many readings: at step 0 the scenario's prior, later what was heard."""
    if not track.started and mission.belief_step == 0:
        return track.prior, 0
    readings = mission.readings
    if stage.parts.clusters.is_open:
        readings = yield from _ask_everyone(stage, track, head)
    if not stage.fleet.alive[head]:
        raise HeadDied
    if not readings:
        raise TrackLost("no_readings")
    fleet, parts = stage.fleet, stage.parts
    nodes = np.array(sorted(readings), dtype=np.int64)
    values = np.array([readings[node] for node in nodes.tolist()])
    estimate = parts.acquire.estimate(
        values,
        fleet.positions[nodes],
        fleet.traits[nodes],
        parts.filter_sensor,
        parts.filter_motions[track.target],
        track.prior,
    )
    return estimate, len(values)


def _ask_everyone(stage: RunContext, track: Track, head: int) -> Generator[simpy.Event, Any, dict[int, float]]:
    """The readings of all who sense, sent to a head that was not elected by its neighbours."""
    sensing = stage.sensing[track.target]
    letters = [Datagram(node, head, Parcel(value, 1, PACKET_BITS, "reading")) for node, value in sensing.items()]
    if letters:
        yield stage.air.carry(letters, track.target)
    return {item.source: sensing[item.source] for item in letters if item.arrived and item.source in sensing}
