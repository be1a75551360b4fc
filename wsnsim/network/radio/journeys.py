"""Datagrams that are forwarded hop by hop, in one copy or several, and the random numbers of the nodes that do it.

A sender whose acknowledgement is lost sends again although its frame arrived: two copies are then under way. A datagram
has ended when all of its packets arrived, or when there is no copy left.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import Burst
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import GOLDEN, MASK, derive, mix
from wsnsim.network.radio.datagrams import Datagram


class Journey:
    """One datagram under way.

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

    __slots__ = ("hops", "journey", "mask", "packets", "sequence", "since", "tries")

    def __init__(self, journey: Journey, hops: int, mask: Bools, packets: int, sequence: int, since: float) -> None:
        self.journey = journey
        self.hops = hops
        self.mask = mask
        self.packets = packets
        self.sequence = sequence
        self.tries = 0
        self.since = since

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
