"""Transport: parcels from node to node, over one hop or as the scenario's `routing` forwards them.

transport.carry(datagrams, target) -> simpy.Event                   fires when every datagram has ended
transport.broadcast(sources, parcels, target) -> (event, bursts)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import simpy

from wsnsim.base.frames import EVERYONE, Burst, full_burst
from wsnsim.base.mac_mechanisms import ExpectsMembers, KeepsIdleSlots, MacMechanism
from wsnsim.base.requests import Parcel
from wsnsim.network.event_log import then
from wsnsim.network.radio.datagrams import A_SINK, Datagram, Forwarding, Hops
from wsnsim.network.radio.topology import RadioServices


class Transport:
    """What nodes send with.

    Args:
        radio: The services of the radio.
        mac: The MAC.
        hops: How bursts cross one hop.
        forwarding: How datagrams cross several.

    Attributes:
        hops: How bursts cross one hop.
        topology: The links.
        expect: (head, members): tells the MAC whom a head takes for members, before they have something to send.
        schedule: (head, nodes): tells a MAC that keeps idle slots who needs one from now on.
        keeps_idle_slots: Whether a gathering takes the time of a round even if no member has something to send.
    """

    def __init__(self, radio: RadioServices, mac: MacMechanism, hops: Hops, forwarding: Forwarding) -> None:
        self._env = radio.env
        self.topology = radio.topology
        self._forwarding = forwarding
        self.hops = hops
        self.keeps_idle_slots = isinstance(mac, KeepsIdleSlots) and mac.keeps_idle_slots
        self.expect: Callable[[int, Sequence[int]], None] = (
            mac.expect if isinstance(mac, ExpectsMembers) else (lambda head, members: None)
        )
        self.schedule: Callable[[int, Sequence[int]], None] = (
            mac.schedule if isinstance(mac, KeepsIdleSlots) and mac.keeps_idle_slots else (lambda head, nodes: None)
        )
        self._pairs: set[tuple[int, int]] = set()

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
            if datagram.to == A_SINK:
                datagram.to = self._forwarding.sink_of(datagram.source)
            if datagram.source == datagram.to:
                datagram.arrived, datagram.arrived_at = True, self._env.now
            elif self._goes_directly(datagram.source, datagram.to, one_hop):
                direct.append(datagram)
            else:
                relayed.append(datagram)
        events: list[simpy.Event] = [self._forwarding.forward(datagram, target) for datagram in relayed]
        if direct or not relayed:
            events.append(self._one_hop(direct, target, head))
        return events[0] if len(events) == 1 else self._env.all_of(events)

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
        return self.hops.send(bursts), bursts

    def connected(self, a: int, b: int) -> bool:
        """Whether two nodes are one hop apart; remembered where distance alone decides, since nodes stand still."""
        if (a, b) in self._pairs:
            return True
        connected = self.topology.connected(a, b)
        if connected and self.topology.distance_only:
            self._pairs.add((a, b))
        return connected

    def _one_hop(self, datagrams: list[Datagram], target: int, head: int | None) -> simpy.Event:
        bursts = [full_burst(datagram.source, datagram.to, datagram.parcel, target) for datagram in datagrams]
        for datagram, burst in zip(datagrams, bursts, strict=True):
            datagram.hops, datagram.last_hop = 1, burst
        event = self.hops.send(bursts, head)
        then(event, self._complete, datagrams, bursts)
        return event

    def _complete(self, datagrams: list[Datagram], bursts: list[Burst]) -> None:
        """Write what arrived over their one hop into datagrams."""
        for datagram, burst in zip(datagrams, bursts, strict=True):
            datagram.bits = burst.sent
            datagram.end(burst.mask, burst.packets > 0, self._env.now)

    def _goes_directly(self, source: int, to: int, one_hop: bool) -> bool:
        """Whether a datagram takes one hop, to a destination that is within range and need not be woken."""
        if to == A_SINK or not self.connected(source, to):
            return False
        if self.hops.wake_neighbour is not None and self.hops.sleeps(to):
            return False
        return one_hop or self._forwarding.is_one_hop(source, to)
