"""The frames of a cluster head that no tracker requests: announcements, questions to the neighbours, wake-ups."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.outlook import Appointment
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.vector_readings import Reading
from wsnsim.network.clusters.driver import HeadDied
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.radio.transport import Datagram, Transport


@dataclass(frozen=True, slots=True)
class HeadMessages:
    """Sends what heads send outside their trackers' flows."""

    network: NetworkView
    transport: Transport

    def recruit(self, target: int, head: int) -> Generator[simpy.Event, Any, list[int]]:
        """Broadcast an announcement; each sensing node that hears it sends a join. Return who joined, ascending."""
        alive, readings = self.network.nodes.alive, self.network.readings
        self.network.log.add("announce", target, head)
        heard = yield from self.ask(target, head, "announce", PACKET_BITS)
        joining = [node for node in heard if node in readings[target]]
        joins = [Datagram(node, head, Parcel(None, 1, PACKET_BITS, "join")) for node in joining]
        if joins:
            yield self.transport.carry(joins, target, one_hop=True)
        if not alive[head]:
            raise HeadDied
        joined = [join.source for join in joins if join.arrived and alive[join.source]]
        for node in joined:
            self.network.log.add("join", target, node, peer=head)
        return joined

    def ask(self, target: int, head: int, what: str, bits: int) -> Generator[simpy.Event, Any, list[int]]:
        """Broadcast a packet; return the living nodes that heard it, ascending.

        Raises:
            HeadDied: the head went down.
        """
        return [*(yield from self._broadcast(target, head, Parcel(None, 1, bits, what)))]

    def announce(
        self, target: int, head: int, appointment: Appointment, payload: Parcel | None
    ) -> Generator[simpy.Event, Any, dict[int, Bools]]:
        """Broadcast an appointment, and a tracker's payload in the same burst.

        Returns:
            {node: (packets,) which packets of the payload arrived} of the nodes that received the appointment, whether
            it covers them or not.

        Raises:
            HeadDied: the head went down.
        """
        own = appointment.packets
        packets, bits = (0, PACKET_BITS) if payload is None else (payload.packets, payload.packet_bits)
        self.network.log.add("announce", target, head)
        parcel = Parcel(None, own + packets, max(bits, PACKET_BITS), "announce")
        heard = yield from self._broadcast(target, head, parcel)
        return {node: mask[own:] for node, mask in heard.items() if mask[:own].all()}

    def expect(self, head: int, members: Sequence[int]) -> None:
        """Have slots arranged for the members of a head, where the MAC has slots."""
        self.transport.expect(head, members)

    def linked(self, head: int, nodes: Iterable[int]) -> list[int]:
        """Those of the nodes that reach the head over one hop."""
        return [node for node in nodes if self.transport.connected(node, head)]

    def _broadcast(self, target: int, head: int, parcel: Parcel) -> Generator[simpy.Event, Any, dict[int, Bools]]:
        """Broadcast a parcel; return which packets arrived at each living node, ascending."""
        event, (burst,) = self.transport.broadcast([head], [parcel], target)
        yield event
        alive = self.network.nodes.alive
        if not alive[head]:
            raise HeadDied
        return {node: burst.received[node] for node in sorted(burst.received) if alive[node]}

    def readings_of_everyone(self, target: int, head: int) -> Generator[simpy.Event, Any, dict[int, Reading]]:
        """Let every sensing node send its reading to the head; return {node: reading} of what arrived."""
        readings = self.network.readings[target]
        datagrams = [Datagram(node, head, Parcel(value, 1, PACKET_BITS, "reading")) for node, value in readings.items()]
        if datagrams:
            yield self.transport.carry(datagrams, target)
        arrived = [datagram.source for datagram in datagrams if datagram.arrived]
        return {node: readings[node] for node in arrived if node in readings}

    def wake(self, target: int, head: int, node: int) -> Generator[simpy.Event, Any, bool]:
        """Send a node a packet that wakes it; return whether it arrived."""
        datagram = Datagram(head, node, Parcel(None, 1, PACKET_BITS, "wake"))
        yield self.transport.carry([datagram], target)
        return datagram.arrived
