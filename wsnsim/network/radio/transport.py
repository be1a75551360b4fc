"""Transport: parcels from node to node, over the path that the scenario's `routing` names.

transport.carry(datagrams, target) -> simpy.Event                   fires when every datagram has ended
transport.broadcast(sources, parcels, target) -> (event, bursts)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Sequence
from math import nan
from typing import Any, Protocol, cast

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import EVERYONE, Burst, full_burst
from wsnsim.base.mac_mechanisms import ExpectsMembers, MacMechanism
from wsnsim.base.optional_ports import defined_together
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import event
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.topology import Neighbours
from wsnsim.network.radio.unicasts import Unicasts

DROP = KIND["drop"]


class Datagram:
    """A parcel on its way to its destination, over one hop or several.

    Attributes:
        source: The node that sends it.
        to: Its destination.
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


class SendsUnicasts(Protocol):
    """A MAC that can send unicasts at one instant: its class defines both this and `send`."""

    def send_unicasts(self, unicasts: Unicasts) -> simpy.Event | None:
        """Send them by one event; None if sending takes time."""


class Transport:
    """What nodes send with.

    Attributes:
        wake_neighbour: (node, sleeping neighbour, target) -> event: wakes the destination of a datagram; None if
            sleeping nodes cannot be woken.
    """

    def __init__(self, radio: RadioServices, mac: MacMechanism, router: Router) -> None:
        self._env = radio.env
        self._nodes = radio.nodes
        self._topology = radio.topology
        self._log = radio.log
        self._mac = mac
        self._router = router
        at_once = defined_together(type(mac), "send_unicasts", "send")
        self._send_unicasts = cast(SendsUnicasts, mac).send_unicasts if at_once else _send_no_unicasts
        self._expect = mac.expect if isinstance(mac, ExpectsMembers) else _expect_nobody
        self._pairs: set[tuple[int, int]] = set()
        self.wake_neighbour: Callable[[int, int, int], simpy.Event] | None = None

    def carry(
        self, datagrams: Sequence[Datagram], target: int, head: int | None = None, one_hop: bool = False
    ) -> simpy.Event:
        """Send datagrams; each ends with what arrived written into it.

        Args:
            datagrams: The datagrams.
            target: The target that they are about.
            head: The cluster head, if they are all between it and its members; a MAC may then use slots.
            one_hop: Whether a destination within range is sent to directly, as between a head and the members of its
                cluster. Otherwise routing decides, whether the destination is within range or not.

        Returns:
            An event that fires when the last datagram has ended.
        """
        direct, relayed = [], []
        for datagram in datagrams:
            if datagram.source == datagram.to:
                datagram.arrived, datagram.arrived_at = True, self._env.now
            elif self._goes_directly(datagram.source, datagram.to, one_hop):
                direct.append(datagram)
            else:
                relayed.append(datagram)
        events: list[simpy.Event] = [self._env.process(self._relay(datagram, target)) for datagram in relayed]
        if direct or not relayed:
            events.append(self._one_hop(direct, target, head))
        return events[0] if len(events) == 1 else self._env.all_of(events)

    def at_once(self, unicasts: Unicasts, one_hop: bool) -> simpy.Event | None:
        """Send parcels over one hop each and without a datagram.

        Args:
            unicasts: The parcels, none of them from a node to itself; afterwards with what arrived.
            one_hop: As for `carry`.

        Returns:
            An event that fires when the last has ended. None, and nothing is sent, where they need a datagram each: the
            MAC takes time, or some node is several hops away.
        """
        if self._send_unicasts is _send_no_unicasts:
            return None
        ends = [*zip(unicasts.sources, unicasts.destinations, strict=True)]
        near = one_hop and self.wake_neighbour is None and self._pairs.issuperset(ends)
        if not near and not all(self._goes_directly(source, to, one_hop) for source, to in ends):
            return None
        return self._send_unicasts(unicasts)

    def broadcast(
        self, sources: Sequence[int], parcels: Sequence[Parcel], target: int, sequence: int = 0, relayed: bool = False
    ) -> tuple[simpy.Event, list[Burst]]:
        """Broadcast one parcel from each source.

        Args:
            sources: The senders.
            parcels: Their parcels.
            target: The target that they are about.
            sequence: The number of the message; 0 for a new one.
            relayed: Whether the senders relay a message of another node.

        Returns:
            An event that fires when the last broadcast has ended, and the bursts; see `Burst.received`.
        """
        bursts = [full_burst(source, EVERYONE, parcel, target) for source, parcel in zip(sources, parcels, strict=True)]
        for burst in bursts:
            burst.sequence, burst.relayed = sequence, relayed
        return self._send(bursts), bursts

    def expect(self, head: int, members: Sequence[int]) -> None:
        """Tell the MAC whom a head takes for members, before they have something to send."""
        self._expect(head, members)

    def neighbours(self, node: int) -> Neighbours:
        """The neighbours of a node, dead nodes included."""
        return self._topology.neighbours(node)

    def connected(self, a: int, b: int) -> bool:
        """Whether two nodes are one hop apart; remembered where distance alone decides, since nodes stand still."""
        if (a, b) in self._pairs:
            return True
        connected = self._topology.connected(a, b)
        if connected and self._topology.distance_only:
            self._pairs.add((a, b))
        return connected

    def _send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        return cast(simpy.Event, self._mac.send(bursts, head))

    def _one_hop(self, datagrams: list[Datagram], target: int, head: int | None) -> simpy.Event:
        sources, destinations = [datagram.source for datagram in datagrams], [datagram.to for datagram in datagrams]
        unicasts = Unicasts(sources, destinations, [datagram.parcel for datagram in datagrams], target)
        event = self._send_unicasts(unicasts)
        if event is None:
            bursts = unicasts.split()
            for datagram, burst in zip(datagrams, bursts, strict=True):
                datagram.hops, datagram.last_hop = 1, burst
            event = self._send(bursts, head)
        assert event.callbacks is not None, "bursts end later than they are sent"
        event.callbacks.append(lambda _: _complete(datagrams, unicasts, self._env.now))
        return event

    def _relay(self, datagram: Datagram, target: int) -> Generator[simpy.Event, Any, None]:
        """Send a datagram over several hops; each hop sends what arrived over the one before."""
        source, parcel = datagram.source, datagram.parcel
        path = self._router.path(source, datagram.to)
        if path is None:
            self._drop(datagram, target)
            return
        sequence, mask, packets = 0, datagram.mask, parcel.packets
        for node, to in itertools.pairwise(path):
            if self.wake_neighbour is not None and to == datagram.to and self._sleeps(to):
                yield self.wake_neighbour(node, to, target)
            burst = Burst(node, to, parcel, target, mask, packets, sequence, relayed=node != source)
            datagram.hops += 1
            datagram.last_hop = burst if to == datagram.to else None
            yield self._send([burst])
            datagram.bits += burst.sent
            sequence, mask, packets = burst.sequence, burst.mask, burst.packets
            if packets == 0:
                break
        _end(datagram, mask, packets > 0, self._env.now)

    def _goes_directly(self, source: int, to: int, one_hop: bool) -> bool:
        """Whether a datagram takes one hop, to a destination that is within range and need not be woken.

        A neighbour without a path died: the sender does not know, and sends in vain.
        """
        if not self.connected(source, to) or (self.wake_neighbour is not None and self._sleeps(to)):
            return False
        path = None if one_hop else self._router.path(source, to)
        return path is None or len(path) == 2

    def _sleeps(self, node: int) -> bool:
        return bool(self._nodes.alive[node]) and not self._nodes.is_awake(node)

    def _drop(self, datagram: Datagram, target: int) -> None:
        """Log that no path leads to the destination."""
        source, to, packets = datagram.source, datagram.to, datagram.parcel.packets
        datagram.mask = np.zeros(packets, dtype=np.bool_)
        now, step, code = self._env.now, self._log.step, self._log.code("no_path")
        self._log.add(event(now, step, target, source, DROP, code, peer=to, packets=packets))


def _complete(datagrams: list[Datagram], unicasts: Unicasts, now: float) -> None:
    """Write what arrived over their one hop into datagrams."""
    if unicasts.bursts is None:
        for datagram in datagrams:
            parcel = datagram.parcel
            datagram.arrived, datagram.arrived_at = True, now
            datagram.hops, datagram.bits = 1, parcel.packets * parcel.packet_bits
        return
    for datagram, burst in zip(datagrams, unicasts.bursts, strict=True):
        datagram.hops, datagram.bits, datagram.last_hop = 1, burst.sent, burst
        _end(datagram, burst.mask, burst.packets > 0, now)


def _end(datagram: Datagram, mask: Bools, arrived: bool, now: float) -> None:
    """Write into a datagram what arrived of it, and when: as the MAC noted, otherwise now."""
    datagram.mask, datagram.arrived = mask, arrived
    if arrived:
        burst = datagram.last_hop
        datagram.arrived_at = now if burst is None or burst.heard is None else burst.heard_at


def _send_no_unicasts(unicasts: Unicasts) -> simpy.Event | None:
    """Return None: the MAC sends bursts only."""
    return None


def _expect_nobody(head: int, members: Sequence[int]) -> None:
    """Do nothing: the MAC gives no slots."""
