"""Datagrams, the protocol of forwarding strategies, and journeys hop by hop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from typing import Final, Protocol, cast

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import Burst
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.rng import GOLDEN, MASK, derive, mix
from wsnsim.network.radio.topology import RadioServices

A_SINK: Final = -2
"""Destination of a datagram that any of the sinks may receive."""


class Datagram:
    """A parcel on its way to its destination, over one hop or several.

    Attributes:
        source: The node that sends it.
        to: Its destination. A_SINK: any sink; once it has arrived, the sink that it reached.
        parcel: What is sent.
        mask: (packets,) which packets arrived, after `Transport.carry`.
        arrived: Whether any packet arrived.
        arrived_at: When the last packet arrived, in s.
        hops: The number of hops that it took.
        bits: The bits sent for it, over all hops.
        last_hop: The burst on its last hop, once it is there.
    """

    __slots__ = ("arrived", "arrived_at", "bits", "hops", "last_hop", "mask", "parcel", "source", "to")

    def __init__(self, source: int, to: int, parcel: Parcel) -> None:
        self.source = source
        self.to = to
        self.parcel = parcel
        self.mask = all_arrived(parcel.packets)
        self.arrived = False
        self.arrived_at = nan
        self.hops = 0
        self.bits = 0
        self.last_hop: Burst | None = None

    def arrivals(self) -> tuple[Bools, float] | None:
        """(mask, time in s) of the packets that have arrived so far; None for none. Its sender may not know yet."""
        burst = self.last_hop
        if burst is not None and burst.heard is not None:
            return burst.heard, burst.heard_at
        return (self.mask, self.arrived_at) if self.arrived else None

    def end(self, mask: Bools, arrived: bool, now: float) -> None:
        """Note what arrived, and when: as the MAC noted, otherwise now."""
        self.mask, self.arrived = mask, arrived
        if arrived:
            burst = self.last_hop
            self.arrived_at = now if burst is None or burst.heard is None else burst.heard_at

    def lose(self) -> None:
        """Note that no packet arrived."""
        self.mask = np.zeros(self.parcel.packets, dtype=np.bool_)


class Forwarding(Protocol):
    """How datagrams find their way where one hop is not enough, or need not be the best."""

    def sink_of(self, source: int) -> int:
        """The sink to which a datagram of a node to A_SINK goes; A_SINK if that is decided on its way."""

    def is_one_hop(self, source: int, to: int) -> bool:
        """Whether a datagram to a node within range is sent to it directly."""

    def forward(self, datagram: Datagram, target: int) -> simpy.Event:
        """Send a datagram; the event fires when it has ended, with what arrived written into it."""

    def remove(self, node: int) -> None:
        """Forget a node that died or crashed, and what it knew."""

    def restore(self, node: int) -> None:
        """Take up a node that came back; it knows nothing."""

    def forget_links(self) -> None:
        """Forget what was computed from links, because they have changed."""

    def start(self) -> None:
        """The simulation starts."""


class Hops:
    """How bursts cross one hop, and how a node that sleeps is woken first.

    Attributes:
        wake_neighbour: (node, sleeping neighbour, target) -> event: wakes the destination of a datagram; None if
            sleeping nodes cannot be woken.
    """

    def __init__(self, radio: RadioServices, mac: MacMechanism) -> None:
        self._env = radio.env
        self._nodes = radio.nodes
        self._log = radio.log
        self._mac = mac
        self.wake_neighbour: Callable[[int, int, int], simpy.Event] | None = None

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Send bursts by the MAC; the event fires when the last one has ended."""
        return cast(simpy.Event, self._mac.send(bursts, head))

    def waking(self, node: int, to: int, target: int) -> simpy.Event | None:
        """Begin to wake a sleeping neighbour, and return the event of it; None if it need not or cannot be woken."""
        return self.wake_neighbour(node, to, target) if self.wake_neighbour is not None and self.sleeps(to) else None

    def sleeps(self, node: int) -> bool:
        """Whether a node is up and asleep."""
        return bool(self._nodes.alive[node]) and not self._nodes.is_awake(node)

    def drop(self, datagram: Datagram, node: int, target: int, reason: str, sequence: int = 0) -> None:
        """Log that a node dropped a datagram, and why."""
        to = datagram.to if datagram.to != A_SINK else -1
        self._log.drop(self._env.now, target, node, reason, to, datagram.parcel.packets, sequence)


class Journey:
    """One datagram under way.

    A sender whose acknowledgement is lost sends again although its frame arrived: two copies are then under way. A
    datagram has ended when all of its packets arrived, or when there is no copy left.

    Args:
        env: The clock.
        datagram: The datagram.
        target: The target that it is about.
        number: Number of the datagram, by which nodes recognise it.
        header: Bits that forwarding adds to each packet.

    Attributes:
        parcel: What is sent over each hop.
        ended: Fires when the datagram has ended.
    """

    __slots__ = ("_copies", "_env", "_mask", "datagram", "ended", "number", "parcel", "target")

    def __init__(self, env: simpy.Environment, datagram: Datagram, target: int, number: int, header: int) -> None:
        self._env = env
        self._copies = 0
        self._mask = np.zeros(datagram.parcel.packets, dtype=np.bool_)
        self.datagram = datagram
        self.target = target
        self.number = number
        given = datagram.parcel
        self.parcel = Parcel(given.payload, given.packets, given.packet_bits + header, given.what)
        self.ended = env.event()

    def add_copy(self) -> None:
        """A node has taken a copy."""
        self._copies += 1

    def end_copy(self) -> None:
        """A node no longer has its copy. Without any, what has not arrived is lost."""
        self._copies -= 1
        if self._copies == 0 and not self.ended.triggered:
            self._end()

    @property
    def is_last_copy(self) -> bool:
        """Whether the datagram is lost with the next copy that is dropped: a drop that is logged."""
        return self._copies == 1 and not self.ended.triggered

    def arrive(self, at: int, hop: Burst, hops: int) -> None:
        """A copy has arrived at the destination, with all packets or some. The last one that brings any is noted."""
        if self.ended.triggered or not (hop.mask & ~self._mask).any():
            return
        datagram = self.datagram
        datagram.to, datagram.hops, datagram.last_hop = at, hops, hop
        self._mask = self._mask | hop.mask
        if self._mask.all():
            self._end()

    def _end(self) -> None:
        arrived = bool(self._mask.any())
        self.datagram.end(self._mask, arrived, self._env.now)
        self.ended.succeed()


@dataclass(slots=True, eq=False)
class Copy:
    """A copy of a datagram at one node, which is to send it on.

    Attributes:
        journey: The datagram.
        hops: Hops so far (THL, the time that it has lived).
        mask: (packets,) which packets of the parcel have arrived here.
        packets: The number of these packets.
        sequence: Number of the datagram in the event log; 0 before the first hop.
        tries: Transmissions from this node so far.
        since: When the node got it, in s.
    """

    journey: Journey
    hops: int
    mask: Bools
    packets: int
    sequence: int
    since: float
    tries: int = 0

    @property
    def key(self) -> tuple[int, int]:
        """By this nodes recognise a copy that they have had: the datagram, and how many hops it has behind it."""
        return self.journey.number, self.hops

    def burst(self, node: int, to: int) -> Burst:
        """Return the burst that takes it over a hop."""
        journey = self.journey
        relayed = node != journey.datagram.source
        return Burst(node, to, journey.parcel, journey.target, self.mask, self.packets, self.sequence, relayed)

    def after(self, burst: Burst, now: float) -> Copy:
        """Return the copy that the receiver of a burst has."""
        return Copy(self.journey, self.hops + 1, burst.mask, burst.packets, burst.sequence, now)


def node_random(key: int, node: int) -> Callable[[], float]:
    """Return a function that gives random numbers in [0, 1) to one node, independently of all others."""
    state = derive(key, node)

    def uniform() -> float:
        nonlocal state
        state = (state + GOLDEN) & MASK
        return (mix(state) >> 11) * 2.0**-53

    return uniform
