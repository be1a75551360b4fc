"""Measurements that members send to the head, and that the head sends back to all members."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Scene
from wsnsim.base.requests import (
    PACKET_BITS,
    Broadcast,
    Delivery,
    Flow,
    GatheredReadings,
    GatherReadings,
    Member,
    Parcel,
    Scatter,
)
from wsnsim.base.vector_readings import is_finite
from wsnsim.trackers.shared.parcels import is_whole, parcel

READINGS = "readings"
NUMBERS_A_PACKET = 4


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Measurements, with what is known of the nodes that made them.

    Attributes:
        ids: (S,) the nodes.
        readings: (S,) their measurements, in the sensor's unit; (S, M) if these have M > 1 components.
        positions: (S, 2) of the nodes in m, as filters assume them.
        traits: (S, T) of their sensors.
    """

    ids: tuple[int, ...]
    readings: Floats
    positions: Floats
    traits: Floats


class RangeSensor(Protocol):
    """A sensor whose measurements stand for distances: what trackers with `needs = ("ranges",)` require."""

    def ranges(self, readings: Floats) -> Floats:
        """The distance in m at which each measurement is expected, (S,)."""
        ...


def ranges_of(seen: Evidence, sensor: object) -> Floats:
    """The distance in m at which each measurement is expected, (S,), in the plane if the sensor says how.

    The scenario's check requires a `RangeSensor`. One whose nodes differ in gain or height has `ranges_in_plane`.
    """
    if hasattr(sensor, "ranges_in_plane"):
        in_plane: Floats = sensor.ranges_in_plane(seen.readings, seen.traits)
        return in_plane
    return cast(RangeSensor, sensor).ranges(seen.readings)


def reading_parcel(member: Member, bits: int = PACKET_BITS) -> Parcel | None:
    """A member's own measurement in one packet; None if it has none, or it is not finite.

    Args:
        member: The member.
        bits: Bits of the packet.
    """
    if member.reading is None or not is_finite(member.reading):
        return None
    return Parcel(member.reading, 1, bits, "reading", readings=1)


def gather_readings(scene: Scene, bits: int = PACKET_BITS) -> Flow[Evidence]:
    """The measurements that reached the head, in one packet per member; the head's own costs nothing.

    It is a flow: `seen = yield from gather_readings(scene)`. Positions and traits of the members are known to the head.

    Args:
        scene: What the head knows.
        bits: Bits of each packet.
    """
    answer: GatheredReadings = yield GatherReadings(bits)
    ids = scene.ids
    if answer.ids == ids:
        return Evidence(ids, answer.values, scene.positions, scene.traits)
    places = {node: place for place, node in enumerate(answer.ids)}
    rows = [row for row, node in enumerate(ids) if node in places]
    values = answer.values[[places[ids[row]] for row in rows]]
    return Evidence(tuple([ids[row] for row in rows]), values, scene.positions[rows], scene.traits[rows])


def share_readings(scene: Scene) -> Flow[Evidence]:
    """Gather the readings, and broadcast those that arrived to the members' inboxes, four numbers in a packet.

    A member needs the positions of the others to use their readings: we assume that they exchanged them when the
    cluster formed, at no extra cost (our choice).
    """
    evidence = yield from gather_readings(scene)
    if not evidence.ids:
        return evidence
    everything = parcel(evidence, -(-len(evidence.ids) // _readings_a_packet(evidence)), READINGS)
    yield Broadcast(everything)
    if scene.head in scene.ids:
        yield Scatter({scene.head: everything})
    return evidence


def own_evidence(member: Member) -> Evidence:
    """A member's own measurement; empty if it has none."""
    count = 0 if member.reading is None else 1
    values = np.array([member.reading][:count], dtype=np.float64)
    return Evidence((member.id,)[:count], values, member.position[None, :][:count], member.traits[None, :][:count])


def evidence_at(member: Member, heard: list[Delivery]) -> Evidence:
    """The measurements at a member: those of the broadcast whose packets arrived, and always its own."""
    for delivery in heard:
        if delivery.what == READINGS:
            shared: Evidence = delivery.payload
            if is_whole(delivery.mask) and (member.reading is None or member.id in shared.ids):
                return shared
            return _merge(member, shared, np.repeat(delivery.mask, _readings_a_packet(shared))[: len(shared.ids)])
    return own_evidence(member)


def _merge(member: Member, shared: Evidence, arrived: np.ndarray) -> Evidence:
    """The measurements of the broadcast that arrived, with the member's own."""
    kept = [row for row, node in enumerate(shared.ids) if arrived[row] and node != member.id]
    own = own_evidence(member)
    readings = own.readings.reshape(len(own.ids), *shared.readings.shape[1:])
    return Evidence(
        tuple(shared.ids[row] for row in kept) + own.ids,
        np.concatenate([shared.readings[kept], readings]),
        np.concatenate([shared.positions[kept], own.positions]),
        np.concatenate([shared.traits[kept], own.traits]),
    )


def _readings_a_packet(evidence: Evidence) -> int:
    """How many whole readings fit into a packet, which holds four numbers."""
    return max(1, NUMBERS_A_PACKET // (evidence.readings.shape[1] if evidence.readings.ndim > 1 else 1))
