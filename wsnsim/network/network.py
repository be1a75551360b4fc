"""What networks with targets and networks without have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, failed_run
from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.ports import Recorder
from wsnsim.base.rng import Streams
from wsnsim.base.setups import RadioSetup
from wsnsim.network.energy.energy_steps import EnergySteps
from wsnsim.network.event_log import EventLog
from wsnsim.network.faults.schedule import FaultSchedule
from wsnsim.network.faults.services import FaultSite, NodeControl
from wsnsim.network.places import Places
from wsnsim.network.radio.radio_stack import make_radio_stack
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import NetworkOutcome
from wsnsim.network.step_clock import StepClock

Steps = Generator[simpy.Event, Any, None]


@dataclass(frozen=True, slots=True)
class Sensors:
    """Where the nodes stand: positions (N, 2) in m; their sensors' constants, traits (N, T); and the positions assumed.

    `assumed` (N, 2) are the positions in m that filters, cluster heads and messages use; None: those where they stand.
    """

    positions: Floats
    traits: Floats
    assumed: Floats | None = None


class Network(ABC):
    """A network: its nodes, their radio stack, the faults, and how nodes go down and come back.

    A subclass defines what happens in a step and how a death is logged, and makes the faults.
    """

    _faults: FaultSchedule

    def __init__(
        self, setup: RadioSetup, replicate: int, sensors: Sensors, streams: Streams, recorder: Recorder,
        count_links: bool = False,
    ) -> None:  # fmt: skip
        self._setup = setup
        self._replicate = replicate
        self._recorder = recorder
        self._event_log = log = EventLog(recorder, replicate)
        self._stack = stack = make_radio_stack(setup, sensors.positions, sensors.traits, streams, log, count_links)
        self._env, self._nodes = stack.radio.env, stack.radio.nodes
        if sensors.assumed is not None and sensors.assumed is not sensors.positions:
            self._nodes.assumed = Places(sensors.assumed)
        self._clock = StepClock(self._env, setup.dt)
        self._router = Router(stack.radio, setup.routing.weight, setup.link.audible)
        stack.radio.topology.on_change = self._router.restore
        self._transport = Transport(stack.radio, stack.mac, self._router)
        self._energy_steps = EnergySteps(self._env, self._nodes, recorder)

    def _make_faults(
        self, key: int, head_of: Callable[[int], int | None], defects: dict[int, SensorDefect]
    ) -> FaultSchedule:
        """Return the faults of the scenario; sensor defects are put into `defects`."""
        control = NodeControl(self._crash, self._restart, head_of)
        site = FaultSite(self._env, self._nodes, self._event_log, self._stack.clocks, control, defects)
        return FaultSchedule(self._setup.faults, site, key, self._setup.dt)

    def _start(self) -> None:
        """Take down the nodes that died while the network was built, and begin with the faults."""
        self._nodes.on_death = self._handle_death
        for node in self._nodes.died_early:
            self._handle_death(node)
        self._faults.start()

    def _run_until(self, ended: simpy.Event) -> NetworkOutcome:
        """Run until an event, and return the outcome. Errors name the seed, the run and the simulated time."""
        try:
            self._env.run(until=ended)
        except ResultError:
            raise
        except (Exception, SystemExit) as raised:  # a plug-in may exit
            reason = raised.__cause__ or raised
            raise failed_run(self._env.now, self._setup.seed, self._replicate, reason) from reason
        awake = self._nodes.duty_cycles.awake_fraction(self._env.now)
        self._energy_steps.end(self._clock.step)
        self._energy_steps.write(self._replicate, self._setup.dt, self._recorder)
        links = self._stack.links.columns()
        if links:
            self._recorder.write("links", {"replicate": self._replicate, **links})
        counters, fingerprint = self._stack.radio.counters, self._event_log.fingerprint()
        return NetworkOutcome(self._nodes, counters, fingerprint, awake, steps=self._clock.step)

    def _begin_step(self, step: int) -> None:
        """Close the step before, and count a new one."""
        if step:
            self._energy_steps.close(step - 1)
        self._clock.step = self._event_log.step = step
        self._event_log.flush()

    def _handle_death(self, node: int) -> None:
        """Take down a node whose battery is empty, whatever it is doing."""
        self._nodes.died_at[node] = self._env.now
        self._log_death(node)
        self._take_down(node)

    @abstractmethod
    def _log_death(self, node: int) -> None: ...

    def _crash(self, node: int) -> None:
        """Take down a node: end what it does, and forget what it knows."""
        self._stack.mac.silence(node)
        self._nodes.crash(node)
        if node not in self._nodes.died_at:
            self._take_down(node)

    def _restart(self, node: int) -> None:
        """Bring back a node that was down, at rest and without a role."""
        self._nodes.restart(node, self._env.now)
        self._router.restore()

    def _take_down(self, node: int) -> None:
        """End what a node that is no longer up was doing."""
        self._router.remove(node)
        self._stack.mac.silence(node)
