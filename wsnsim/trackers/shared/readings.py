"""Measurements that members send to the head and that it sends back, and the number of packets of what is sent.

A packet of 12 bytes is 4 bytes of header and 8 of payload: four int16 of a state or of weights, or eight replication
counts, or one reading (Jiang 2013, section 5). Quantisation only counts for the number of packets: values arrive
unrounded, but for readings of a sensor that quantises them, whose packets have 4 bytes of header and their bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, is_finite
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import (
    HEADER_BITS,
    PACKET_BITS,
    Broadcast,
    Delivery,
    Flow,
    Gather,
    GatheredReadings,
    GatherReadings,
    Member,
    Parcel,
    Scatter,
    all_arrived,
)
from wsnsim.trackers.shared.moments import predicted

PARTICLES: Final = "particles"
MOMENTS: Final = "moments"
UNKNOWN: Final = float("nan")
"""The log-weight of a particle that arrived without its weight."""


def parcel(payload: Any, packets: int, what: str) -> Parcel:
    """A parcel of 12-byte packets.

    Args:
        payload: What it carries.
        packets: The number of packets.
        what: Its name in the event log.
    """
    return Parcel(payload, packets, PACKET_BITS, what)


def state_packets(columns: int) -> int:
    """The number of packets of one state: four numbers each.

    Args:
        columns: D, the number of state columns.
    """
    return -(-columns // 4)


def number_packets(numbers: int) -> int:
    """Packets of so many numbers: four each."""
    return -(-numbers // 4)


def count_packets(count: int) -> int:
    """Packets of `count` replication counts: eight each."""
    return -(-count // 8)


def covariance_packets(columns: int) -> int:
    """Packets of a symmetric matrix: its lower triangle, four numbers each."""
    return -(-columns * (columns + 1) // 8)


def moment_packets(columns: int) -> int:
    """The number of packets of a mean and its covariance: four numbers each, of the covariance the lower triangle.

    Args:
        columns: D, the number of state columns.
    """
    return state_packets(columns) + covariance_packets(columns)


def particles_parcel(cloud: Floats, log_weights: Floats | float) -> Parcel:
    """Particles (D, n), then their weights (n,): n state packets and ceil(n / 4).

    A common weight is sent in the header of the first packet (our choice): only n state packets.
    """
    columns, count = cloud.shape
    packets = count * state_packets(columns) + (number_packets(count) if isinstance(log_weights, np.ndarray) else 0)
    return parcel((cloud, log_weights), packets, PARTICLES)


def arrived_particles(sent: tuple[Floats, Floats | float], mask: Bools) -> tuple[Floats, Floats]:
    """Of the payload of a `particles_parcel`: the particles (D, m) whose packets arrived, and their log-weights (m,).

    `mask` begins with the parcel's packets. A weight whose packet is lost is UNKNOWN.
    """
    cloud, log_weights = sent
    columns, count = cloud.shape
    each = log_weights if isinstance(log_weights, np.ndarray) else np.full(count, log_weights)
    if is_whole(mask):
        return cloud, each
    whole = arrived_groups(mask, count, state_packets(columns))
    if each is log_weights:
        first = count * state_packets(columns)
        known = np.repeat(mask[first : first + number_packets(count)], 4)[:count]
        each = np.where(known, each, UNKNOWN)
    return np.ascontiguousarray(cloud[:, whole]), each[whole]


def is_whole(mask: Bools) -> bool:
    """Whether all packets arrived. Complete deliveries share their masks, which makes this case fast."""
    return mask is all_arrived(mask.size) or bool(mask.all())


def arrived_groups(mask: Bools, count: int, packets: int) -> Bools:
    """(count,) which of the first `count` items in a burst arrived whole, each of `packets` packets."""
    whole: Bools = np.all(mask[: count * packets].reshape(count, packets), axis=1)
    return whole


def guessed(log_weights: Floats) -> Floats:
    """The log-weights with each UNKNOWN one replaced by the mean of the others, or by weight one if none is known."""
    lost = np.isnan(log_weights)
    if not lost.any():
        return log_weights
    return np.where(lost, log_mean(log_weights[~lost]), log_weights)


def log_mean(log_weights: Floats) -> float:
    """The log of the mean weight; 0 where there is none, or nothing has weight."""
    top = log_weights.max() if log_weights.size else -np.inf
    if not np.isfinite(top):
        return 0.0
    return float(top + np.log(np.mean(np.exp(log_weights - top))))


READINGS = "readings"
PREDICTION: Final = "prediction"
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

    def part(self, rows: Ints | Bools) -> Evidence:
        """Some of the measurements, by a mask (S,) or by their numbers."""
        ids = tuple(np.array(self.ids, dtype=np.int64)[rows].tolist())
        return Evidence(ids, self.readings[rows], self.positions[rows], self.traits[rows])


def together(one: Evidence, other: Evidence) -> Evidence:
    """The measurements of both."""
    pairs = ((getattr(one, name), getattr(other, name)) for name in ("readings", "positions", "traits"))
    return Evidence(one.ids + other.ids, *map(np.concatenate, pairs))


def replied(reply: Mapping[int, tuple[Any, Bools]], scene: Scene) -> Evidence:
    """The measurements that members sent, one each, in the order of the scene's members."""
    rows = [row for row, node in enumerate(scene.ids) if node in reply]
    ids = tuple([scene.ids[row] for row in rows])
    values = np.array([reply[node][0] for node in ids], dtype=np.float64)
    return Evidence(ids, values, scene.positions[rows], scene.traits[rows])


def ranges_of(seen: Evidence, sensor: Any) -> Floats:
    """The distance (S,) in m at which each measurement is expected; in the plane if the sensor model offers that.

    The scenario's check requires `ranges`. A sensor whose nodes differ in gain or height has `ranges_in_plane`.
    """
    in_plane = hasattr(sensor, "ranges_in_plane")
    ranges: Floats = sensor.ranges_in_plane(seen.readings, seen.traits) if in_plane else sensor.ranges(seen.readings)
    return ranges


def reading_parcel(member: Member, bits: int = PACKET_BITS) -> Parcel | None:
    """A member's own measurement in one packet; None if it has none, or it is not finite.

    Args:
        member: The member.
        bits: Bits of the packet.
    """
    if member.reading is None or not is_finite(member.reading):
        return None
    return Parcel(member.reading, 1, bits, "reading", readings=1)


def packet_bits(sensor: SensorModel, bits: int = PACKET_BITS) -> int:
    """The bits of a packet with one reading: `bits`, or fewer where a reading takes few."""
    few = getattr(sensor, "reading_bits", None)
    return bits if few is None else min(bits, HEADER_BITS + few)


def gather_readings(scene: Scene, bits: int = PACKET_BITS, belief: Any = None) -> Flow[Evidence]:
    """The measurements that reached the head, in one packet per member; the head's own costs nothing.

    It is a flow: `seen = yield from gather_readings(scene)`. Positions and traits of the members are known to the head.

    Args:
        scene: What the head knows.
        bits: Bits of each packet.
        belief: Anything with `mean` and `cov` of the last step, from which it is predicted for members that quantise
            their reading about what the head expects.
    """
    bits = packet_bits(scene.sensor, bits)
    if belief is not None and getattr(scene.sensor, "adapts", False):
        return (yield from _gather_about(belief, scene, bits))
    reply: GatheredReadings = yield GatherReadings(bits)
    return evidence_of(reply, scene)


def evidence_of(reply: GatheredReadings, scene: Scene) -> Evidence:
    """Measurements with what the head knows of the members that made them, in the order of the members.

    Args:
        reply: The measurements.
        scene: What the head knows of their step.
    """
    ids = scene.ids
    if reply.ids == ids:  # all members: nothing to select
        return Evidence(ids, reply.values, scene.positions, scene.traits)
    places = {node: place for place, node in enumerate(reply.ids)}
    rows = [row for row, node in enumerate(ids) if node in places]
    values = reply.values[[places[ids[row]] for row in rows]]
    return Evidence(tuple([ids[row] for row in rows]), values, scene.positions[rows], scene.traits[rows])


def _gather_about(belief: Any, scene: Scene, bits: int) -> Flow[Evidence]:
    """The readings that arrived, quantised about the predicted position, which is broadcast before."""
    mean, cov = predicted(belief.mean, belief.cov, scene)
    place, sensor = list(scene.motion.position), scene.sensor
    told = parcel((mean[place], cov[np.ix_(place, place)]), moment_packets(len(place)), PREDICTION)
    if set(scene.ids) - {scene.head}:
        yield Broadcast(told)
    if scene.head in scene.ids:
        yield Scatter({scene.head: told})
    seen = replied((yield Gather(partial(_reading_about, sensor=sensor, bits=bits))), scene)
    traits = sensor.with_thresholds(*told.payload, seen.positions, seen.traits)  # type: ignore[attr-defined]
    return replace(seen, traits=traits)


def _reading_about(member: Member, sensor: Any, bits: int) -> Parcel | None:
    """A member's reading, quantised about the prediction that it was sent; None if that or the reading is missing."""
    told = [each.payload for each in member.take_inbox() if each.what == PREDICTION and is_whole(each.mask)]
    if not told or member.reading is None or not is_finite(member.reading):
        return None
    traits = sensor.with_thresholds(*told[-1], member.position[None], member.traits[None])
    (value,) = sensor.quantised(np.array([member.reading]), traits).tolist()
    return Parcel(value, 1, bits, "reading", readings=1)


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
    count = 0 if member.reading is None else 1  # slices up to it keep the number of dimensions
    values = np.array([member.reading][:count], dtype=np.float64)
    return Evidence((member.id,)[:count], values, member.position[None, :][:count], member.traits[None, :][:count])


def evidence_at(member: Member, heard: list[Delivery]) -> Evidence:
    """The measurements at a member: those of the broadcast whose packets arrived, and always its own."""
    for delivery in heard:
        if delivery.what == READINGS:
            shared: Evidence = delivery.payload
            # nothing is lost, and the member's own measurement is among them, if it has one
            if is_whole(delivery.mask) and (member.reading is None or member.id in shared.ids):
                return shared
            return _merge(member, shared, np.repeat(delivery.mask, _readings_a_packet(shared))[: len(shared.ids)])
    return own_evidence(member)


def _merge(member: Member, shared: Evidence, arrived: np.ndarray) -> Evidence:
    """The measurements of the broadcast that arrived, with the member's own."""
    own = own_evidence(member)
    own = replace(own, readings=own.readings.reshape(len(own.ids), *shared.readings.shape[1:]))
    return together(shared.part(arrived & (np.array(shared.ids) != member.id)), own)


def _readings_a_packet(evidence: Evidence) -> int:
    """How many whole readings fit into a packet, which holds four numbers."""
    return max(1, NUMBERS_A_PACKET // (evidence.readings.shape[1] if evidence.readings.ndim > 1 else 1))


Linear: TypeAlias = tuple[Floats, Floats, Floats]
"""Expected readings, their gradients and their variances, as `linearised` gives them."""


def linearised(points: Floats, sensor: SensorModel, positions: Floats, traits: Floats) -> Linear:
    """The sensor model at points (P, N) for n sensors: expected (n, N), gradients (n, P, N), variances (n, N)."""
    expected, gradients, variances = sensor.linearise(points, positions, traits)
    # kernels are compiled for contiguous arrays
    return np.ascontiguousarray(expected), np.ascontiguousarray(gradients), np.ascontiguousarray(variances)


def arrived_probabilities(probabilities: Floats, mask: Bools) -> Floats:
    """The probabilities (n,) after a transfer of four per packet: lost ones become equal, so that the sum is 1."""
    known = np.repeat(mask[: number_packets(probabilities.size)], 4)[: probabilities.size]
    if known.all():
        return probabilities
    missing = max(1.0 - float(probabilities[known].sum()), 0.0)
    return np.where(known, probabilities, missing / np.count_nonzero(~known))
