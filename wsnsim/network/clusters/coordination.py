"""The protocol of cluster heads, what heads send, and who is the head of which track.

coordination.fill_vacancy(track, poll)      coordination.withdraw(node), coordination.forget(node)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Final, NamedTuple, Protocol

import simpy

from wsnsim.base.arrays import Bools, Reading
from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.base.network_ports import Appointment
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.collection import Deadline
from wsnsim.network.clusters.driver import DriverServices, HeadDied
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.estimates import Estimates
from wsnsim.network.clusters.network_view import NetworkView, TargetSearch, WakeIntervals
from wsnsim.network.clusters.track import Handover, LastClusterDone, Track, TrackLost
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


PROTOCOLS: Final = {
    "standing": "standing_cluster:StandingClusterProtocol",
    "electing": "standing_cluster:ElectingClusterProtocol",
    "open": "standing_cluster:OpenClusterProtocol",
    "moving": "moving_head:MovingHeadProtocol",
    "appointing": "appointing:AppointingProtocol",
}
"""The head protocols by the names that cluster policies give: a run imports its own only."""


class ClusterCoordination:
    """Owns the assignment of heads to tracks. A head leads a track in an activity of its own process.

    `ended` fires when the run ends with a cluster.

    Args:
        tracks: The tracks, one per target.
        driver: What performs the requests of trackers.
        processes: The processes of the nodes.
        estimates: What tracks report.
        wake_ahead: Has nodes woken for the next step.
        search: What awake nodes detect of a target without a track.
    """

    def __init__(
        self, tracks: Sequence[Track], driver: DriverServices, processes: NodeProcesses, estimates: Estimates,
        wake_ahead: WakeAhead, search: TargetSearch,
    ) -> None:  # fmt: skip
        network, transport = driver.network, driver.transport
        self._clock, self._log = network.clock, network.log
        self._processes, self._tracks = processes, tracks
        self.ended = network.clock.env.event()
        elections = Elections(network, transport, processes, self.appoint)
        messages = HeadMessages(network, transport, driver.intervals)
        self._protocol = make_head_protocol(
            HeadServices(network, messages, driver, elections, estimates, wake_ahead, processes, search)
        )

    def fill_vacancy(self, track: Track, poll: int) -> None:
        """Look for a head, if the track has none and no election is under way."""
        if track.head is None and track.election is None:
            handover = self._protocol.fill_vacancy(track, poll)
            if handover is not None:
                self.appoint(track, handover)

    def appoint(self, track: Track, handover: Handover) -> None:
        """Make the handover's successor the head of the track."""
        track.head = handover.successor
        process = self._processes.of(handover.successor)
        process.serve(track.target)
        process.begin(self._lead(track, handover))

    def head_of(self, target: int) -> int | None:
        """The head of a target's track; None if it has none, or there is no such target."""
        return self._tracks[target].head if target < len(self._tracks) else None

    def withdraw(self, node: int) -> None:
        """Withdraw a node that is no longer up from elections."""
        for track in self._tracks:
            if track.election is not None and node in track.election.readings:
                track.election.withdraw(node)

    def forget(self, node: int) -> None:
        """Remove a node that crashed, with its memory, from its clusters."""
        for track in self._tracks:
            if track.cluster is not None:
                track.cluster.forget(node)

    def _lead(self, track: Track, handover: Handover) -> Acting[None]:
        """Lead one track as its head, from taking over until handing over."""
        head = handover.successor
        try:
            if not handover.acts_now:
                yield track.tick
            following = yield from self._protocol.lead(track, handover)
            if following is not None:
                self._dissolve(track)
                self.appoint(track, following)
        except (HeadDied, simpy.Interrupt):
            if track.head == head:  # otherwise another head leads already
                self._lose(track, "head_died")
        except TrackLost as lost:
            self._lose(track, str(lost))
        except LastClusterDone:
            if not self.ended.triggered:
                self.ended.succeed()
        except WsnsimError:
            raise
        except Exception as reason:  # SimPy rebuilds exceptions from their arguments, which not every class allows
            raise RunError(f"{type(reason).__name__}: {reason}") from reason
        if track.head != head:
            self._processes.of(head).dismiss(track.target)

    def _dissolve(self, track: Track) -> None:
        """Dismiss the members of the track's cluster; their memories are lost."""
        if track.cluster is not None:
            track.clusters[-1].released = self._clock.now
            self._protocol.release(track, track.cluster)
            track.cluster = None

    def _lose(self, track: Track, why: str) -> None:
        """Log the loss of the belief, and leave the track without a head."""
        self._log.add("lost", track.target, -1 if track.head is None else track.head, why)
        self._dissolve(track)
        track.head = None


def make_head_protocol(services: HeadServices) -> HeadProtocol:
    """The head protocol of a scenario's cluster policy.

    Raises:
        RunError: there is none of that name.
    """
    name = services.network.setup.head_protocol
    if name not in PROTOCOLS:
        raise RunError(f"clusters: no head protocol '{name}' in this network; known: {', '.join(PROTOCOLS)}")
    module, kind = PROTOCOLS[name].split(":")
    protocol: HeadProtocol = getattr(import_module(f"wsnsim.network.clusters.{module}"), kind)(services)
    return protocol
