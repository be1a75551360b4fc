"""Datagrams, and how they find their way over several hops: the protocol of forwarding strategies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Final, Protocol, cast

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import Burst
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import event
from wsnsim.network.radio.radio_services import RadioServices

A_SINK: Final = -2
"""Destination of a datagram that any of the sinks may receive."""
DROP: Final = KIND["drop"]


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
        log, to = self._log, datagram.to if datagram.to != A_SINK else -1
        packets = datagram.parcel.packets
        log.add(
            event(
                self._env.now, log.step, target, node, DROP, log.code(reason),
                sequence=sequence, peer=to, packets=packets,
            )
        )  # fmt: skip
