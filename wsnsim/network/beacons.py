"""A network without a target: every node broadcasts a beacon now and then, to be found and to measure the radio.

BeaconWorld(problem, replicate, positions, streams, recorder).run() -> NetworkOutcome
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import numpy as np
import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Recorder
from wsnsim.base.rng import Streams, derive_all, uniforms
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND
from wsnsim.network.energy.energy_steps import EnergySteps
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.fault_services import FaultSite, NodeControl
from wsnsim.network.faults import FaultSchedule
from wsnsim.network.outcome import NetworkOutcome
from wsnsim.network.radio.radio_stack import make_radio_stack, run_until

Beaconing = Generator[simpy.Event, Any, None]


class BeaconWorld:
    """One network whose nodes broadcast."""

    def __init__(
        self, problem: BeaconSetup, replicate: int, positions: Floats, streams: Streams, recorder: Recorder
    ) -> None:
        self._problem = problem
        self._replicate = replicate
        self._recorder = recorder
        self._journal = EventLog(recorder, replicate)
        ether = make_radio_stack(problem, positions, np.ones((len(positions), 0)), streams, self._journal)
        if ether.wiring.sharp:
            ether.wiring.survey()
        self._env = env = ether.env
        self._fleet = fleet = ether.fleet
        self._clocks, self._mac = ether.clocks, ether.mac
        if recorder.wants("links"):
            self._mac.count_links()
        fleet.on_death = self._bury
        self._costs = EnergySteps(env, fleet, recorder)
        self.beacons = 0
        self._code = self._journal.code("beacon")
        phases = uniforms(derive_all(streams.key("beacons"), np.arange(fleet.size)), 0)
        for node, phase in enumerate((phases * problem.workload.period).tolist()):
            env.process(self._beacon(node, phase))
        FaultSchedule(problem.faults, self._site(), streams.key("faults"), problem.dt).start()

    def run(self, progress: Callable[[float], None] | None = None) -> NetworkOutcome:
        """Run to the end. A failure names seed, replicate and simulated time."""
        problem = self._problem
        clock = self._env.process(self._clock(progress))
        run_until(self._env, clock, problem.seed, self._replicate)
        awake = self._fleet.awake_fraction(self._env.now)
        self._costs.end(problem.steps - 1)
        self._costs.write(self._replicate, problem.dt, self._recorder)
        self._write_links()
        return NetworkOutcome(self._fleet, self._mac.counts, self._journal.fingerprint(), awake)

    def _clock(self, progress: Callable[[float], None] | None) -> Beaconing:
        dt = self._problem.dt
        for step in range(self._problem.steps):
            self._journal.step = step
            self._journal.flush()
            if progress:
                progress(self._env.now)
            yield self._env.timeout((step + 1) * dt - self._env.now)
            if step + 1 < self._problem.steps:
                self._costs.close(step)

    def _beacon(self, node: int, phase: float) -> Beaconing:
        """A node's life: it broadcasts once a period of its own clock, as long as it is up and awake."""
        workload, alive = self._problem.workload, self._fleet.alive
        period, bits = self._clocks.lasts(node, workload.period), workload.bits
        yield self._env.timeout(phase)
        while node not in self._fleet.died_at:
            if alive[node] and self._fleet.is_awake(node):
                self.beacons += 1
                self._mac.offer(node, bits, _told, self._code)
            yield self._env.timeout(period)

    def _site(self) -> FaultSite:
        control = NodeControl(self._crash, self._fleet.restart)
        return FaultSite(self._env, self._fleet, self._journal, self._clocks, control)

    def _crash(self, node: int) -> None:
        self._mac.silence(node)
        self._fleet.crash(node)

    def _bury(self, node: int) -> None:
        self._fleet.died_at[node] = self._env.now
        self._log("death", node)
        self._mac.silence(node)

    def _log(self, kind: str, node: int) -> None:
        self._journal.add(event(self._env.now, self._journal.step, -1, node, KIND[kind]))

    def _write_links(self) -> None:
        if self._recorder.wants("links"):
            rows = self._mac.link_rows()
            if rows:
                self._recorder.write("links", {"replicate": self._replicate, **rows})


def _told(heard: Any) -> None:
    """Nobody waits for a beacon."""
