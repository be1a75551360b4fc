"""A network without targets: its nodes do what the workload's mechanism says.

WorkloadWorld(setup, replicate, positions, streams, recorder).run() -> NetworkOutcome
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import numpy as np
import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.mechanisms import WorkloadMechanism
from wsnsim.base.ports import Recorder
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND
from wsnsim.network.energy.energy_steps import EnergySteps
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.faults.schedule import FaultSchedule
from wsnsim.network.faults.services import FaultSite, NodeControl
from wsnsim.network.radio.radio_stack import RadioStack, make_radio_stack, run_until
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.transport import Datagram, Transport
from wsnsim.network.result_rows import NetworkOutcome
from wsnsim.network.workloads.mechanisms import make_workload


class WorkloadNetwork:
    """What a workload may use of a network (`mechanisms.WorkloadServices`). `key` is the workload's random key."""

    def __init__(self, stack: RadioStack, transport: Transport, event_log: EventLog, key: int) -> None:
        nodes = stack.radio.nodes
        self._env = stack.radio.env
        self._nodes = nodes
        self._mac = stack.mac
        self._transport = transport
        self._event_log = event_log
        self.key = key
        self.positions = nodes.positions
        self.is_awake: Callable[[int], bool] = nodes.is_awake
        self.lasts: Callable[[int, float], float] = stack.clocks.lasts
        self.word: Callable[[str], int] = event_log.code

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return self._env.now

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""
        return node in self._nodes.died_at

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        timer = self._env.timeout(seconds)
        assert timer.callbacks is not None
        timer.callbacks.append(lambda _: action())

    def broadcast(self, node: int, bits: int, word: int) -> None:
        """Broadcast a payload of `bits` to all in range."""
        self._mac.offer(node, bits, _ignore_hearers, word)

    def send(self, node: int, to: int, bits: int, what: str, on_end: Callable[[bool], None]) -> None:
        """Send a payload of `bits` to a node, relayed if it is out of range; `on_end(arrived)` is called at the end."""
        item = Datagram(node, to, Parcel(None, 1, bits, what))
        ended = self._transport.carry([item], -1)
        assert ended.callbacks is not None
        ended.callbacks.append(lambda _: on_end(item.arrived))


class WorkloadWorld:
    """One network without targets."""

    workload: WorkloadMechanism

    def __init__(
        self, setup: BeaconSetup, replicate: int, positions: Floats, streams: Streams, recorder: Recorder
    ) -> None:
        self._setup = setup
        self._replicate = replicate
        self._recorder = recorder
        self._event_log = log = EventLog(recorder, replicate)
        traits, count_links = np.ones((len(positions), 0)), recorder.wants("links")
        self._stack = stack = make_radio_stack(setup, positions, traits, streams, log, count_links)
        radio = stack.radio
        if radio.topology.distance_only:
            radio.topology.find_all()
        self._env, self._nodes, self._counters = radio.env, radio.nodes, radio.counters
        self._nodes.on_death = self._handle_death
        self._energy_steps = EnergySteps(radio.env, radio.nodes, recorder)
        self._router = Router(radio, setup.routing.weight, setup.link.audible)
        transport = Transport(radio, stack.mac, self._router)
        services = WorkloadNetwork(stack, transport, log, streams.key("beacons"))
        self.workload = make_workload(setup.workload, services)
        control = NodeControl(self._crash, self._restart)
        site = FaultSite(radio.env, radio.nodes, log, stack.clocks, control)
        FaultSchedule(setup.faults, site, streams.key("faults"), setup.dt).start()

    def run(self, progress: Callable[[float], None] | None = None) -> NetworkOutcome:
        """Run to the end. An error names seed, run and simulated time."""
        setup, nodes = self._setup, self._nodes
        self.workload.begin()
        steps = self._env.process(self._run_steps(progress))
        run_until(self._env, steps, setup.seed, self._replicate)
        awake = nodes.duty_cycles.awake_fraction(self._env.now)
        self._energy_steps.end(setup.steps - 1)
        self._energy_steps.write(self._replicate, setup.dt, self._recorder)
        self._write_links()
        return NetworkOutcome(nodes, self._counters, self._event_log.fingerprint(), awake)

    def _run_steps(self, progress: Callable[[float], None] | None) -> Generator[simpy.Event, Any, None]:
        dt = self._setup.dt
        for step in range(self._setup.steps):
            self._event_log.step = step
            self._event_log.flush()
            if progress:
                progress(self._env.now)
            yield self._env.timeout((step + 1) * dt - self._env.now)
            if step + 1 < self._setup.steps:
                self._energy_steps.close(step)

    def _crash(self, node: int) -> None:
        self._stack.mac.silence(node)
        self._nodes.crash(node)
        self._router.remove(node)

    def _restart(self, node: int) -> None:
        self._nodes.restart(node)
        self._router.restore()

    def _handle_death(self, node: int) -> None:
        self._nodes.died_at[node] = self._env.now
        self._event_log.add(event(self._env.now, self._event_log.step, -1, node, KIND["death"]))
        self._stack.mac.silence(node)
        self._router.remove(node)

    def _write_links(self) -> None:
        columns = self._stack.links.columns()
        if columns:
            self._recorder.write("links", {"replicate": self._replicate, **columns})


def _ignore_hearers(heard: Any) -> None:
    """No node waits for the end of a broadcast."""
