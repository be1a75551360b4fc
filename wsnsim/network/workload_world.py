"""A network without targets: its nodes do what the workload's mechanism says.

WorkloadWorld(setup, replicate, positions, streams, recorder).run() -> NetworkOutcome
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.mechanisms import WorkloadMechanism, WorkloadServices
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import Streams, derive_all, uniforms
from wsnsim.base.runs import OnTime
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND, Recorder
from wsnsim.models.workloads import Periodic, PeriodicCollection
from wsnsim.network.base_network import BaseNetwork
from wsnsim.network.event_log import Acting, event, then
from wsnsim.network.mechanisms import NetworkServices, make_mechanism
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.radio.radio_stack import RadioStack
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import NetworkOutcome, ReportRows


class Repeating:
    """Nodes send again and again, each at a phase of its own; one that is down or asleep when it is due does not.

    `send(node, bits, what)` sends once, from `start_at` s on. `sent` is the number of times that nodes tried to send.
    """

    def __init__(
        self, component: Periodic | PeriodicCollection, services: WorkloadServices, nodes: Iterable[int],
        send: Callable[[int, int, Any], None], what: Any, start_at: float = 0.0,
    ) -> None:  # fmt: skip
        self._services, self._nodes, self._send, self._what = services, nodes, send, what
        self._period, self._bits, self._start_at = component.period, component.bits, start_at
        self._actions: dict[int, Callable[[], None]] = {}
        self.sent = 0

    def begin(self) -> None:
        """Set the timers of the nodes, at random phases."""
        services, period = self._services, self._period
        phases = (uniforms(derive_all(services.key, np.arange(len(services.positions))), 0) * period).tolist()
        for node in self._nodes:
            self._actions[node] = partial(self._act, node, services.lasts(node, period))
            services.call_later(self._start_at + phases[node], self._actions[node])

    def _act(self, node: int, period: float) -> None:
        """Let a node send if it is up and awake, and set its timer again, to a period in true seconds."""
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            self.sent += 1
            self._send(node, self._bits, self._what)
        services.call_later(period, self._actions[node])


def beacons(component: Periodic, services: WorkloadServices) -> Repeating:
    """Return the built-in workload of a network without targets: all nodes broadcast beacons."""
    everyone, code = range(len(services.positions)), services.code_of("beacon")
    return Repeating(component, services, everyone, services.broadcast, code)


def collection_reports(component: PeriodicCollection, services: WorkloadServices) -> Repeating:
    """Return the workload in which all nodes but the sinks report."""
    nodes = [node for node in range(len(services.positions)) if node not in services.sinks]

    def collect(node: int, bits: int, what: str) -> None:
        services.collect(node, bits, what, _ignore)

    return Repeating(component, services, nodes, collect, "report", component.start_at)


def _ignore(outcome: object) -> None:
    """Take the outcome of a broadcast or a report: nothing waits for it."""


class WorkloadNetwork(NetworkServices):
    """What a workload may use of a network (`mechanisms.WorkloadServices`). `key` is the workload's random key."""

    def __init__(
        self, stack: RadioStack, transport: Transport, reports: ReportRows, key: int
    ) -> None:  # fmt: skip
        super().__init__(stack.radio.env, stack.radio.nodes, stack.clocks)
        self._mac = stack.mac
        self._transport = transport
        self._reports = reports
        self.sinks: Sequence[int] = stack.sinks
        self.key = key
        self.positions = stack.radio.nodes.positions
        self.code_of: Callable[[str], int] = stack.radio.log.code

    def broadcast(self, node: int, bits: int, code: int) -> None:
        """Broadcast a payload of `bits` to all in range."""
        self._mac.offer(node, bits, _ignore, code)

    def send(self, node: int, to: int, bits: int, what: str, on_end: Callable[[bool], None]) -> None:
        """Send a payload of `bits` to a node over the path of `routing`; `on_end(arrived)` is called at the end."""
        datagram = Datagram(node, to, Parcel(None, 1, bits, what))
        ended = self._transport.carry([datagram], -1)
        then(ended, lambda: on_end(datagram.arrived))

    def collect(self, node: int, bits: int, what: str, on_end: Callable[[int], None]) -> None:
        """Send a report of `bits` to whichever sink; `on_end(sink)` is called at the end, with -1 if it was lost."""
        report = Datagram(node, A_SINK, Parcel(None, 1, bits, what))
        ended = self._reports.send(report, -1)
        then(ended, lambda: on_end(report.to if report.arrived else -1))


class WorkloadWorld(BaseNetwork):
    """One network without targets."""

    _setup: BeaconSetup

    def __init__(
        self, setup: BeaconSetup, replicate: int, positions: Floats, streams: Streams, recorder: Recorder
    ) -> None:
        nodes = InitialConditions(positions, np.ones((len(positions), 0)), [], [], positions)
        super().__init__(setup, replicate, nodes, streams, recorder, count_links=recorder.wants("links"))
        self._stack.radio.topology.find_all()
        services = WorkloadNetwork(self._stack, self._transport, self._reports, streams.key("beacons"))
        self.workload: WorkloadMechanism = make_mechanism("workload", setup.workload, services)

    def run(self, progress: OnTime | None = None) -> NetworkOutcome:
        """Run to the end and return the outcome. Errors name the seed, the run and the simulated time."""
        return self._run(self._run_steps(progress))

    def _start(self) -> None:
        super()._start()
        self.workload.begin()

    def _run_steps(self, progress: OnTime | None) -> Acting[None]:
        for step in range(self._setup.steps + 1):
            self._begin_step(step)
            if progress:
                progress(self._env.now)
            yield self._env.timeout((step + 1) * self._setup.dt - self._env.now)

    def _log_change(self, kind: str, node: int) -> None:
        log = self._event_log
        log.add(event(self._env.now, log.step, -1, node, KIND[kind]))
