"""A network without targets: its nodes do what the workload's mechanism says.

WorkloadWorld(setup, replicate, positions, streams, recorder).run() -> NetworkOutcome
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.mechanisms import WorkloadMechanism, WorkloadServices
from wsnsim.base.ports import Recorder
from wsnsim.base.progress import OnTime
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import Streams, derive_all, uniforms
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND
from wsnsim.models.workloads import Periodic, PeriodicCollection
from wsnsim.network.base_network import BaseNetwork, Sensors, Steps
from wsnsim.network.event_log import event, then
from wsnsim.network.mechanisms import NetworkServices, make_mechanism
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.radio.radio_stack import RadioStack
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import NetworkOutcome, ReportRows


class Beacons:
    """The built-in workload of a network without targets. `sent` is the number of beacons that nodes tried to send."""

    def __init__(self, component: Periodic, services: WorkloadServices) -> None:
        self._component = component
        self._services = services
        self._code = services.code_of("beacon")
        self._periods: list[float] = []
        self._actions: list[Callable[[], None]] = []
        self.sent = 0

    def begin(self) -> None:
        """Set the timer of every node's first beacon."""
        services, period = self._services, self._component.period
        phases = uniforms(derive_all(services.key, np.arange(len(services.positions))), 0)
        self._periods = [services.lasts(node, period) for node in range(len(services.positions))]
        self._actions = [partial(self._send, node) for node in range(len(services.positions))]
        for action, phase in zip(self._actions, (phases * period).tolist(), strict=True):
            services.call_later(phase, action)

    def _send(self, node: int) -> None:
        """Broadcast a node's beacon if it is up and awake, and set the timer of the next one."""
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            self.sent += 1
            services.broadcast(node, self._component.bits, self._code)
        services.call_later(self._periods[node], self._actions[node])


class CollectionReports:
    """The workload in which all nodes report. A node that is down or asleep when its report is due leaves it out."""

    def __init__(self, component: PeriodicCollection, services: WorkloadServices) -> None:
        self._component = component
        self._services = services
        self._actions: dict[int, Callable[[], None]] = {}

    def begin(self) -> None:
        """Set the timer of every node's first report, at a random phase after `start_at`."""
        services, component = self._services, self._component
        phases = uniforms(derive_all(services.key, np.arange(len(services.positions))), 0).tolist()
        for node, phase in enumerate(phases):
            if node not in services.sinks:
                self._actions[node] = partial(self._report, node)
                services.call_later(component.start_at + phase * component.period, self._actions[node])

    def _report(self, node: int) -> None:
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            services.collect(node, self._component.bits, "report", _ignore)
        services.call_later(services.lasts(node, self._component.period), self._actions[node])


def _ignore(outcome: object) -> None:
    """Take the outcome of a broadcast or a report: nothing waits for it."""


class WorkloadNetwork(NetworkServices):
    """What a workload may use of a network (`mechanisms.WorkloadServices`). `key` is the workload's random key."""

    def __init__(
        self, stack: RadioStack, transport: Transport, reports: ReportRows, sinks: Sequence[int], key: int
    ) -> None:  # fmt: skip
        super().__init__(stack.radio.env, stack.radio.nodes, stack.clocks)
        self._mac = stack.mac
        self._transport = transport
        self._reports = reports
        self.sinks = sinks
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
        sensors = Sensors(positions, np.ones((len(positions), 0)))
        super().__init__(setup, replicate, sensors, streams, recorder, count_links=recorder.wants("links"))
        self._stack.radio.topology.find_all()
        services = WorkloadNetwork(self._stack, self._transport, self._reports, self._sinks, streams.key("beacons"))
        self.workload: WorkloadMechanism = make_mechanism("workload", setup.workload, services)
        self._faults = self._make_faults(streams.key("faults"), lambda target: None, {})

    def run(self, progress: OnTime | None = None) -> NetworkOutcome:
        """Run to the end and return the outcome. Errors name the seed, the run and the simulated time."""
        self._start()
        self.workload.begin()
        return self._run_until(self._env.process(self._run_steps(progress)))

    def _run_steps(self, progress: OnTime | None) -> Steps:
        for step in range(self._setup.steps + 1):
            self._begin_step(step)
            if progress:
                progress(self._env.now)
            yield self._env.timeout((step + 1) * self._setup.dt - self._env.now)

    def _log_death(self, node: int) -> None:
        log = self._event_log
        log.add(event(self._env.now, log.step, -1, node, KIND["death"]))
