"""Performs a tracker's requests on the network and books what they cost: where mathematics meets simulated time.

    belief = yield from Driver(services, target, head, members).perform(tracker.step(belief, scene))

If the head dies during a flow, the flow is closed and its belief is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Reading
from wsnsim.base.errors import PluginAnswerError
from wsnsim.base.radio import Cpu, EnergyModel
from wsnsim.base.requests import (
    NOBODY,
    Broadcast,
    Compute,
    Delivery,
    Flow,
    Gather,
    Gathered,
    GatheredReadings,
    GatherLate,
    GatherReadings,
    Local,
    Member,
    Parcel,
    Request,
    Scatter,
    Send,
)
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clusters.collection import Collection, Gathering, LateReadings
from wsnsim.network.clusters.network_view import NetworkView, WakeIntervals
from wsnsim.network.event_log import Acting, EventLog, StepClock
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.transport import Transport

COMPUTE: Final = KIND["compute"]
CPU_CAUSE: Final = CAUSE["cpu"]
CPU_EVENT_CAUSE: Final = EVENT_CAUSE["cpu"]


@dataclass(slots=True)
class Processors:
    """Books computations. `operations` is the number computed so far in the whole network."""

    _clock: StepClock
    _nodes: Nodes
    _event_log: EventLog
    _energy: EnergyModel
    _cpu: Cpu
    operations: float = 0.0

    def compute(self, node: int, operations: float, target: int) -> float:
        """Book a computation and return the simulated seconds that it takes; free computations are not logged."""
        self.operations += operations
        cycles = operations * self._cpu.cycles_per_flop
        joules = self._energy.compute(cycles)
        self._nodes.consumption.mark_computing(node, cycles)
        if joules > 0:
            spent = self._nodes.spend(node, CPU_CAUSE, joules)
            now, step = self._clock.env.now, self._clock.step
            self._event_log.add((now, step, target, node, COMPUTE, 0, 0, 0, -1, 0, 0, spent, CPU_EVENT_CAUSE))
        return self._cpu.seconds(cycles)


class HeadDied(Exception):
    """The head went down during a flow."""


class DriverServices(NamedTuple):
    """What drivers use. `intervals`: the nodes' wake intervals, short at the head and at members that hear from it.

    `late`: what arrives after its head has gone on.
    """

    network: NetworkView
    transport: Transport
    processors: Processors
    intervals: WakeIntervals
    late: LateReadings


class Driver:
    """Performs the requests of one head and its cluster.

    Args:
        services: what it uses.
        target: the target of the head's track.
        head: the cluster head.
        members: every member by id, the head included, with its memory of this cluster.
        window: (quiet, cap) in s: the head collects until nothing arrived for `quiet`, at most for `cap`. None: it
            knows when everything has arrived or is lost.
        one_hop: whether members within range are one hop away; otherwise routing decides the paths in the cluster.

    Attributes:
        readings: the number of readings in the last computation.
        heard: {node: reading} of those that the head gathered last.
        answered: all nodes of which a parcel that the head gathered has arrived, in whole or in part.
        hops: hops of the last `Send`.
        collection: sends parcels between the head and its members.
    """

    def __init__(
        self, services: DriverServices, target: int, head: int, members: dict[int, Member],
        window: tuple[float, float] | None = None, one_hop: bool = True,
    ) -> None:  # fmt: skip
        self._services = services
        self._env = services.network.clock.env
        self._alive = services.network.nodes.alive
        self._target = target
        self._head = head
        self._members = members
        self.collection = Collection(self._env, services.transport, target, head, window, one_hop)
        self._uses_late = services.network.setup.uses_late_readings
        self.readings = 0
        self.heard: dict[int, Reading] = {}
        self.answered: set[int] = set()
        self.hops = 0

    def perform(self, flow: Flow[Any]) -> Acting[Any]:
        """Perform a flow's requests and return the flow's belief. The flow is closed, however it ends.

        Raises:
            HeadDied: the head went down.
        """
        answer: Any = None
        self.readings = 0
        self._services.intervals.shorten_for_next_step([] if self._head == NOBODY else [self._head])
        try:
            while True:
                try:
                    request = flow.send(answer)
                except StopIteration as end:
                    return end.value
                if type(request) is Local:
                    answer, seconds = self._local(request)
                    if seconds:
                        yield self._env.timeout(seconds)
                elif fault := self._fault_of(request):  # raised in the flow, which knows its line
                    flow.throw(PluginAnswerError(fault))
                else:
                    answer = yield from self.PERFORMERS[type(request)](self, request)
                if self._head != NOBODY and not self._alive[self._head]:
                    raise HeadDied
        finally:
            flow.close()

    def request(self, request: Request) -> Acting[Any]:
        """Perform one request; returns its answer."""
        return self.perform(_only(request))

    def _fault_of(self, request: Any) -> str:
        """Why a request is refused, or nothing."""
        if type(request) is Send and not 0 <= request.to < len(self._alive):
            return f"Send: expected a node from 0 to {len(self._alive) - 1}, not {request.to}"
        return "" if type(request) in self.PERFORMERS else f"{type(request).__name__}: {self.REQUESTS}"

    def _addressed(self, who: Sequence[int] | None) -> list[Member]:
        """The living members of those that a request addresses; None: those that sense."""
        alive, members = self._alive, self._members
        if who is None:
            return [member for member in members.values() if member.reading is not None and alive[member.id]]
        return [members[node] for node in who if node in members and alive[node]]

    def _local(self, request: Local) -> tuple[tuple[int, ...], float]:
        """Let members compute; return who did, and the seconds that the slowest of them took."""
        addressed = self._addressed(request.who)
        if request.work_all is not None and addressed:
            request.work_all(addressed)
        else:
            for member in addressed:
                request.work(member)
        if request.uses_readings:
            self.readings = len([member for member in addressed if member.reading is not None])
        cycles = request.cycles
        ids = [member.id for member in addressed]
        operations = [cycles(member) for member in addressed] if callable(cycles) else [cycles] * len(ids)
        seconds = max(map(self._compute, ids, operations), default=0.0)
        alive = self._alive
        return tuple([node for node in ids if alive[node]]), seconds

    def _compute(self, node: int, operations: float) -> float:
        return self._services.processors.compute(node, operations, self._target)

    def _compute_at_head(self, request: Compute) -> Acting[None]:
        if seconds := self._compute(self._head, request.cycles):
            yield self._env.timeout(seconds)

    def _gather_late(self, request: GatherLate) -> Acting[dict[int, GatheredReadings]]:
        yield from ()  # makes this a generator: other requests take simulated time
        return self._services.late.arrived(self._target, self._head, request.since, request.until)

    def _gather(self, request: Gather) -> Acting[Gathered]:
        nodes: list[int] = []
        parcels: list[Parcel] = []
        readings: dict[int, tuple[Reading, int]] = {}
        for member in self._addressed(request.who):
            parcel = request.parcel_of(member)
            if parcel is not None:
                nodes.append(member.id)
                parcels.append(parcel)
                if parcel.readings != 0 and (count := parcel.readings_of(member)):
                    assert member.reading is not None, "only a member with a reading sends one"
                    readings[member.id] = member.reading, count
        if request.expected is not None and self._services.transport.keeps_idle_slots:
            yield from self._compute_at_head(Compute(request.expected_cycles))
            self._services.transport.schedule(self._head, request.expected())
        masks, journeys = yield from self.collection.gather(nodes, parcels, self._deadline_of(request))
        answer = Gathered(
            {
                node: (parcel.payload, mask)
                for node, parcel, mask in zip(nodes, parcels, masks, strict=True)
                if mask is not None
            },
            journeys,
        )
        self.answered.update(answer)
        if readings:
            arrived = sorted(readings.keys() & answer.keys())
            self.heard = {node: readings[node][0] for node in arrived}
            self.readings = sum([readings[node][1] for node in arrived])
        return answer

    def _gather_readings(self, request: GatherReadings) -> Acting[GatheredReadings]:
        readings = request.readings_of(self._addressed(request.who))
        form = Parcel(None, 1, request.packet_bits, request.what)
        parcels, deadline = [form] * len(readings), self._deadline_of(request)
        step, began = self._services.network.clock.step, self._env.now
        masks, journeys = yield from self.collection.gather(list(readings), parcels, deadline)
        if self._uses_late and (missing := self.collection.missing):
            self._services.late.keep(self._target, self._head, Gathering(step, began, missing, readings))
        arrived = [node for node, mask in zip(readings, masks, strict=True) if mask is not None]
        self.answered.update(arrived)
        if readings:
            self.heard = {node: readings[node] for node in sorted(arrived)}
            self.readings = len(arrived)
        values = np.array([readings[node] for node in arrived], dtype=np.float64)
        return GatheredReadings(tuple(arrived), values, journeys)

    def _deadline_of(self, request: Gather | GatherReadings) -> float | None:
        return self._services.network.setup.waits.gather if request.deadline is None else request.deadline

    def _scatter(self, request: Scatter) -> Acting[dict[int, Bools]]:
        head, parcels = self._head, {node: each for node, each in request.parcels.items() if node in self._members}
        packets = sum([parcel.packets for node, parcel in parcels.items() if node != head])
        what = next(iter(parcels.values())).what if parcels else ""
        self._services.network.log.add("allocate", self._target, head, what, packets=packets)
        masks = yield from self.collection.exchange([head] * len(parcels), list(parcels), list(parcels.values()))
        return self._deliver(
            {
                node: (parcel, mask)
                for (node, parcel), mask in zip(parcels.items(), masks, strict=True)
                if mask is not None and node in self._members
            }
        )

    def _broadcast(self, request: Broadcast) -> Acting[dict[int, Bools]]:
        sent, (burst,) = self._services.transport.broadcast([self._head], [request.parcel], self._target)
        yield sent
        return self._deliver(
            {node: (request.parcel, mask) for node, mask in burst.received.items() if node in self._members}
        )

    def _send(self, request: Send) -> Acting[Bools]:
        datagram = Datagram(self._head, request.to, request.parcel)
        yield from self.collection.carry([datagram])
        self.hops = datagram.hops
        return datagram.mask

    def _deliver(self, arrived: dict[int, tuple[Parcel, Bools]]) -> dict[int, Bools]:
        """Put what arrived into the inboxes of members; return the masks."""
        for node, (parcel, mask) in arrived.items():
            self._members[node].inbox.append(Delivery(parcel.what, parcel.payload, mask))
        self._services.intervals.shorten_for_next_step(arrived)
        return {node: mask for node, (_, mask) in arrived.items()}

    PERFORMERS: ClassVar[Mapping[type, Callable[[Any, Any], Acting[Any]]]] = {
        Compute: _compute_at_head,
        Gather: _gather,
        GatherReadings: _gather_readings,
        GatherLate: _gather_late,
        Scatter: _scatter,
        Broadcast: _broadcast,
        Send: _send,
    }
    REQUESTS: ClassVar[str] = (
        "requests to a head are Local, Compute, Gather, GatherReadings, GatherLate, Scatter, Broadcast and Send"
    )


def _only(request: Request) -> Flow[Any]:
    """A flow that makes one request, and returns its answer."""
    return (yield request)
