"""What the protocol of cluster heads has: the messages of heads, the services of the network, and the port itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import simpy

from wsnsim.base.arrays import Bools, Reading
from wsnsim.base.network_ports import Appointment
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.collection import Deadline
from wsnsim.network.clusters.driver import DriverServices, HeadDied
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.estimates import Estimates
from wsnsim.network.clusters.network_view import NetworkView, TargetSearch, WakeIntervals
from wsnsim.network.clusters.track import Handover, Track
from wsnsim.network.clusters.wake_ahead import WakeAhead
from wsnsim.network.event_log import Acting, then
from wsnsim.network.node_process import NodeProcesses
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.transport import Transport


@dataclass(frozen=True, slots=True)
class Joins:
    """The answers to an announcement.

    Attributes:
        step: the step of their readings.
        readings: {node: reading} of the nodes that have joined, ascending.
        pending: joins that are still under way, with the events of their ends.
    """

    step: int
    readings: dict[int, Reading]
    pending: list[tuple[Datagram, simpy.Event]]

    @property
    def is_unanswered(self) -> bool:
        """Whether no node has joined, and none is about to."""
        return not self.readings and not self.pending

    def on_end(self, ended: Callable[[int, bool], None]) -> None:
        """Call `ended` at the end of each pending join, with its node and whether it arrived."""
        for join, event in self.pending:
            then(event, lambda join=join: ended(join.source, join.arrived))


@dataclass(frozen=True, slots=True)
class HeadMessages:
    """Sends what heads send outside their trackers' flows."""

    network: NetworkView
    transport: Transport
    intervals: WakeIntervals

    def recruit(self, target: int, head: int) -> Acting[Joins]:
        """Broadcast an announcement; each sensing node that hears it sends a join, with its reading.

        The head waits until all joins have ended; where radios are mostly off, at most for `waits.joins` s.
        """
        network, readings, wait = self.network, self.network.readings, self.network.setup.waits.joins
        network.log.add("announce", target, head)
        heard = yield from self.ask(target, head, "announce", PACKET_BITS)
        step = network.clock.step
        sent = {node: readings[target][node] for node in heard if node in readings[target]}
        self.intervals.shorten_for_next_step([head, *sent])
        joins = [Datagram(node, head, Parcel(value, 1, PACKET_BITS, "join")) for node, value in sent.items()]
        events: list[simpy.Event] = []
        if joins and wait is None:
            yield self.transport.carry(joins, target, one_hop=True)
        elif joins and wait is not None:
            events = [self.transport.carry([join], target, one_hop=True) for join in joins]
            yield network.clock.env.all_of(events) | Deadline(network.clock.env, wait)
        if not network.nodes.alive[head]:
            raise HeadDied
        joined = {join.source: join.parcel.payload for join in joins if join.arrived}
        joined = {node: value for node, value in joined.items() if network.nodes.alive[node]}
        for node in joined:
            network.log.add("join", target, node, peer=head)
        # `events` is empty if the head has waited for all joins
        return Joins(step, joined, [each for each in zip(joins, events, strict=bool(events)) if not each[1].processed])

    def ask(self, target: int, head: int, what: str, bits: int) -> Acting[list[int]]:
        """Broadcast a packet; return the living nodes that heard it, ascending.

        Raises:
            HeadDied: the head went down.
        """
        return [*(yield from self._broadcast(target, head, Parcel(None, 1, bits, what)))]

    def announce(
        self, target: int, head: int, appointment: Appointment, payload: Parcel | None
    ) -> Acting[dict[int, Bools]]:
        """Broadcast an appointment, and a tracker's payload in the same burst.

        Returns:
            {node: (packets,) which packets of the payload arrived} of all nodes that received the appointment,
            appointed or not.

        Raises:
            HeadDied: the head went down.
        """
        own = appointment.packets
        packets, bits = (0, PACKET_BITS) if payload is None else (payload.packets, payload.packet_bits)
        self.network.log.add("announce", target, head)
        parcel = Parcel(None, own + packets, max(bits, PACKET_BITS), "announce")
        heard = yield from self._broadcast(target, head, parcel)
        return {node: mask[own:] for node, mask in heard.items() if mask[:own].all()}

    def linked(self, head: int, nodes: Iterable[int]) -> list[int]:
        """Those of the nodes that reach the head over one hop."""
        return [node for node in nodes if self.transport.connected(node, head)]

    def _broadcast(self, target: int, head: int, parcel: Parcel) -> Acting[dict[int, Bools]]:
        """Broadcast a parcel; return which packets arrived at each living node, ascending."""
        event, (burst,) = self.transport.broadcast([head], [parcel], target)
        yield event
        alive = self.network.nodes.alive
        if not alive[head]:
            raise HeadDied
        return {node: burst.received[node] for node in sorted(burst.received) if alive[node]}

    def readings_of_everyone(self, target: int, head: int) -> Acting[dict[int, Reading]]:
        """Let every sensing node send its reading to the head; return {node: reading} of what arrived."""
        readings = self.network.readings[target]
        datagrams = [Datagram(node, head, Parcel(value, 1, PACKET_BITS, "reading")) for node, value in readings.items()]
        if datagrams:
            yield self.transport.carry(datagrams, target)
        arrived = [datagram.source for datagram in datagrams if datagram.arrived]
        # a node may have stopped sensing meanwhile
        return {node: readings[node] for node in arrived if node in readings}

    def wake(self, target: int, head: int, node: int) -> Acting[bool]:
        """Send a node a packet that wakes it; return whether it arrived."""
        datagram = Datagram(head, node, Parcel(None, 1, PACKET_BITS, "wake"))
        yield self.transport.carry([datagram], target)
        return datagram.arrived


class HeadServices(NamedTuple):
    """What head protocols use."""

    network: NetworkView
    messages: HeadMessages
    driver: DriverServices
    elections: Elections
    estimates: Estimates
    wake_ahead: WakeAhead
    processes: NodeProcesses
    search: TargetSearch


class HeadProtocol(Protocol):
    """What the head of a track does. `ClusterCoordination` calls it, and appoints whom it names."""

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Name a head for a track that has none, or have one elected.

        Args:
            track: the track.
            poll: the number of the instant within the step, from 0.
        """

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Lead a track from the handover on; return the next handover, None if another head leads already.

        Raises:
            TrackLost: the track has no belief any more. LastClusterDone: the run ends here.
        """

    def release(self, track: Track, cluster: Cluster) -> None:
        """Dismiss the members of a cluster that is dissolved."""
