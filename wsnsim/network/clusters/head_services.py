"""What head protocols have: the messages of heads, what a track reports, the services, and the port itself."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Estimate, Reading
from wsnsim.base.network_ports import Appointment
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rows import Issued, wants_belief, write_belief
from wsnsim.base.tables import Recorder
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.collection import Deadline
from wsnsim.network.clusters.driver import Driver, DriverServices, HeadDied
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.network_view import NetworkView, TargetSearch, WakeIntervals
from wsnsim.network.clusters.track import Handover, LastClusterDone, Track, TrackBook
from wsnsim.network.clusters.wake_ahead import WakeAhead
from wsnsim.network.event_log import Acting, then
from wsnsim.network.node_process import NodeProcesses
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import ReportRows


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


@dataclass(frozen=True, slots=True)
class HeadMessages:
    """Sends what heads send outside their trackers' flows."""

    network: NetworkView
    transport: Transport
    intervals: WakeIntervals

    def recruit(self, target: int, head: int, among: Collection[int] | None = None) -> Acting[Joins]:
        """Broadcast an announcement; each sensing node `among` those that hear it sends a join, with its reading.

        The head waits until all joins have ended; where radios are mostly off, at most for `waits.joins` s.
        """
        network, readings, wait = self.network, self.network.readings, self.network.setup.waits.joins
        network.log.add("announce", target, head)
        heard = yield from self.ask(target, head, "announce", PACKET_BITS)
        step = network.clock.step
        called = heard if among is None else [node for node in heard if node in among]
        sent = {node: readings[target][node] for node in called if node in readings[target]}
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
        return [*(yield from self.broadcast(target, head, Parcel(None, 1, bits, what)))]

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
        heard = yield from self.broadcast(target, head, parcel)
        return {node: mask[own:] for node, mask in heard.items() if mask[:own].all()}

    def linked(self, head: int, nodes: Iterable[int]) -> list[int]:
        """Those of the nodes that reach the head over one hop."""
        return [node for node in nodes if self.transport.connected(node, head)]

    def broadcast(self, target: int, head: int, parcel: Parcel) -> Acting[dict[int, Bools]]:
        """Broadcast a parcel; return which packets arrived at each living node, ascending."""
        event, (burst,) = self.transport.broadcast([head], [parcel], target)
        yield event
        alive = self.network.nodes.alive
        if not alive[head]:
            raise HeadDied
        return {node: burst.received[node] for node in sorted(burst.received) if alive[node]}


class Estimates:
    """Initiates tracks, records their estimates, and has heads report them, each to one of the sinks.

    Attributes:
        received: When a sink received each report, in s: {(target, step): time}.
    """

    def __init__(
        self, network: NetworkView, reports: ReportRows, sinks: Sequence[int], recorder: Recorder, replicate: int
    ) -> None:  # fmt: skip
        self.network = network
        self.recorder = recorder
        self.replicate = replicate
        self.received: dict[tuple[int, int], float] = {}
        self._reports = reports
        self._sinks = sinks
        self._bits, self._interval = network.setup.sink.bits, network.setup.report_every

    def initial(self, track: Track, readings: Mapping[int, Reading]) -> Estimate:
        """The estimate from which a track is initiated, given {node: reading}."""
        setup, at = self.network.setup, self.network.nodes
        nodes = np.array(sorted(readings), dtype=np.int64)
        return setup.acquire.estimate(
            np.array([readings[node] for node in nodes.tolist()]),
            at.assumed.positions[nodes],
            at.traits[nodes],
            setup.filter_sensor,
            setup.filter_motion(track.target),
            track.prior,
        )

    def note_start(self, track: Track, head: int) -> None:
        """Note that a track was initiated; one that was lost before has been reacquired."""
        if track.started:
            track.reacquired += 1
            self.network.log.add("reacquire", track.target, head)
        track.started = True

    def issue(self, track: Track, step: int, scene: Scene, driver: Driver, belief: Any) -> None:
        """Record the estimate of a step and report it to the sink. At step 0 the belief is the prior, no estimate."""
        if step == 0:
            return
        estimate = self.network.setup.tracker.estimate(belief)
        self.network.log.add("estimate", track.target, scene.head)
        assert math.isfinite(sum(estimate.mean.tolist())), (
            f"the tracker's estimate at step {step} is not finite: {estimate.mean}"
        )
        track.estimates[step] = Issued(
            step, self.network.clock.now, estimate, scene.head, scene.active, len(scene.roster), driver.readings
        )
        self.report(scene.head, step, track.target)

    def snapshot(self, track: Track, cluster: Cluster, belief: Any, step: int) -> None:
        """Record the particles and the tracker's state, if their tables are wanted."""
        if not wants_belief(self.recorder):
            return
        setup = self.network.setup
        members = [cluster.members[node] for node in cluster.roster()]
        key = {"replicate": self.replicate, "target": track.target, "step": step}
        write_belief(self.recorder, key, setup.tracker, belief, members, setup.motions[track.target].columns)

    def report(self, head: int, step: int, target: int, packets: int = 1) -> None:
        """Send the estimates of a step to a sink, if a report is due. The head does not wait for its arrival."""
        if not self._sinks or step % self._interval or not packets:
            return
        report = Datagram(head, A_SINK, Parcel(None, packets, self._bits, "report"))
        then(self._reports.send(report, target), self._receive, report, step, target)

    def _receive(self, report: Datagram, step: int, target: int) -> None:
        if report.arrived:
            self.received[target, step] = self.network.clock.now


class HeadServices(NamedTuple):
    """What head protocols use. `book`: the tracks of readings that name no target."""

    network: NetworkView
    messages: HeadMessages
    driver: DriverServices
    elections: Elections
    estimates: Estimates
    wake_ahead: WakeAhead
    processes: NodeProcesses
    search: TargetSearch
    book: TrackBook | None = None


class HeadProtocol(ABC):
    """What the head of a track does. `ClusterCoordination` calls it, and appoints whom it names."""

    def __init__(self, services: HeadServices) -> None:
        self._services, self._network = services, services.network
        self._setup, self._clock, self._log = services.network.setup, services.network.clock, services.network.log

    @abstractmethod
    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Name a head for a track that has none, or have one elected.

        Args:
            track: the track.
            poll: the number of the instant within the step, from 0.
        """

    @abstractmethod
    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Lead a track from the handover on; return the next handover, None if another head leads already.

        Raises:
            TrackLost: the track has no belief any more. LastClusterDone: the run ends here.
        """

    def release(self, track: Track, cluster: Cluster) -> None:
        """Dismiss the members of a cluster that is dissolved."""
        self._services.processes.dismiss(cluster.roster(), track.target)

    def begin(self) -> None:  # noqa: B027 (groups alone do something here)
        """Let groups begin from the scans of this step, where readings name no target."""

    def _count_handover(self, track: Track) -> None:
        """Count that the head hands over. Raises LastClusterDone if the run ends with this cluster."""
        until = self._setup.until_clusters
        if until is not None and len(track.clusters) >= until:
            raise LastClusterDone
        track.handovers += 1
