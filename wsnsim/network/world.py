"""A network that tracks targets: its nodes, its tracks and the order of what happens in a step.

    World(setup, replicate, sensors, targets, streams, recorder).run() -> NetworkOutcome

At each step the nodes in range of a target wake and sense, a track without a head gets one, and every head starts its
step. With moving heads, awake nodes also search for lost targets between steps.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import simpy

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.ports import Estimate, Recorder
from wsnsim.base.rng import Streams
from wsnsim.base.setups import NetworkSetup
from wsnsim.network.clusters.coordination import ClusterCoordination
from wsnsim.network.clusters.driver import DriverServices
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.estimates import Estimates
from wsnsim.network.clusters.head_messages import HeadMessages
from wsnsim.network.clusters.head_protocol import HeadServices
from wsnsim.network.clusters.head_protocols import make_head_protocol
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.processors import Processors
from wsnsim.network.clusters.sink_reports import SinkReports
from wsnsim.network.clusters.target_search import TargetSearch
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_ahead import NoWakeAhead, WakeAhead, WakesAhead
from wsnsim.network.clusters.wake_up_counters import WakeUpCounters
from wsnsim.network.clusters.wake_up_service import WakeUpNetwork, WakeUpService
from wsnsim.network.energy.energy_steps import EnergySteps
from wsnsim.network.event_log import EventLog
from wsnsim.network.faults.schedule import FaultSchedule
from wsnsim.network.faults.services import FaultSite, NodeControl
from wsnsim.network.node import NodeProcesses, NodeServices
from wsnsim.network.radio.radio_stack import make_radio_stack, run_until
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.transport import Transport
from wsnsim.network.result_rows import NetworkOutcome
from wsnsim.network.sensing.imperfect_readings import make_readings
from wsnsim.network.sensing.sensing import CurrentReadings, SensingServices, make_sensing
from wsnsim.network.step_clock import ProtocolLog, StepClock


@dataclass(frozen=True, slots=True)
class Sensors:
    """Where the nodes stand: positions (N, 2) in m; and their sensors' constants, traits (N, T)."""

    positions: Floats
    traits: Floats


@dataclass(frozen=True, slots=True)
class Targets:
    """The targets: per target its trajectory (steps + 1, D) and its prior.

    `paths` are the trajectories at the `setup.polls` instants of a step at which nodes search; if empty, `truths`.
    """

    truths: Sequence[Floats]
    priors: Sequence[Estimate]
    paths: Sequence[Floats] = ()


class World:
    """One network, its targets and the order of events in a step."""

    def __init__(
        self,
        setup: NetworkSetup,
        replicate: int,
        sensors: Sensors,
        targets: Targets,
        streams: Streams,
        recorder: Recorder,
    ) -> None:
        self._setup = setup
        self._replicate = replicate
        self._recorder = recorder
        self._event_log = EventLog(recorder, replicate)
        self._stack = stack = make_radio_stack(setup, sensors.positions, sensors.traits, streams, self._event_log)
        radio = stack.radio
        self._env, self._nodes, self._counters = radio.env, radio.nodes, radio.counters
        self._nodes.on_death = self._handle_death
        self._clock = StepClock(radio.env, setup.dt)
        self._log = ProtocolLog(self._clock, self._event_log)
        self._router = Router(radio, setup.routing.weight, setup.link.audible)
        self._transport = Transport(radio, stack.mac, self._router)
        self._reports = SinkReports(radio, self._transport, setup.sink, setup.dt)
        self._processors = Processors(self._clock, self._nodes, self._event_log, setup.energy, setup.cpu)
        self._energy_steps = EnergySteps(radio.env, radio.nodes, recorder)
        self._tracks = tuple(Track(i, prior, radio.env.event()) for i, prior in enumerate(targets.priors))
        points = [truth[:, list(motion.position)] for truth, motion in zip(targets.truths, setup.motions, strict=True)]
        self._in_field = [setup.deploy.field.contains(planar(path)).tolist() for path in points]
        self._assemble(targets, points, streams)

    def _assemble(self, targets: Targets, points: Sequence[Floats], streams: Streams) -> None:
        """Give each component the services that it uses."""
        setup, nodes, clock = self._setup, self._nodes, self._clock
        available, imperfections = make_readings(setup, targets.truths, nodes, self._stack.clocks, streams.key("sense"))
        readings: CurrentReadings = [{} for _ in points]
        network = NetworkView(setup, clock, nodes, readings, setup.head_threshold, streams.key("tracker"))
        self._wake_up_counters = WakeUpCounters(network, points)
        wakes_ahead = setup.wakeup.mechanism != "none"
        on_wake = _ignore_wake if wakes_ahead else self._wake_up_counters.count_wake
        self._processes = NodeProcesses(NodeServices(self._env, nodes, self._log, on_wake))
        sensing = SensingServices(clock, nodes, self._processes, self._event_log, available, setup.energy.sense())
        self._sensing = make_sensing(sensing, readings, setup.nodes_search)
        self._coordination = ClusterCoordination(clock, self._log, self._processes, self._tracks)
        self._coordination.protocol = make_head_protocol(
            HeadServices(
                network,
                HeadMessages(network, self._transport, self._log),
                DriverServices(self._env, nodes, self._transport, self._processors, self._log),
                Elections(network, self._log, self._transport, self._processes, self._coordination.appoint),
                Estimates(network, self._log, self._reports, self._recorder, self._replicate),
                self._make_wake_ahead(network, streams.key("wakeup")) if wakes_ahead else NoWakeAhead(),
                self._processes,
                TargetSearch(network, available, targets.paths or targets.truths, imperfections, streams.key("search")),
            )
        )
        if self._reports.node is not None:
            nodes.keep_awake(self._reports.node)
        control = NodeControl(self._crash, self._restart, self._coordination.head_of)
        site = FaultSite(self._env, nodes, self._event_log, self._stack.clocks, control, imperfections.defects)
        self._faults = FaultSchedule(setup.faults, site, streams.key("faults"), setup.dt)

    def _make_wake_ahead(self, network: NetworkView, key: int) -> WakesAhead:
        """Make the service that wakes nodes for heads, and the last node of a datagram's path."""
        used = WakeUpNetwork(self._clock, self._nodes, self._processes, self._transport, self._event_log)
        service = WakeUpService(self._setup, used, key)
        self._transport.wake_neighbour = service.call_one
        return WakeAhead(network, service)

    def run(self, progress: Callable[[float], None] | None = None) -> NetworkOutcome:
        """Run to the end and return the outcome. Errors name the seed, the run and the simulated time."""
        self._faults.start()
        steps = self._env.process(self._run_steps(progress))
        ended = self._env.any_of([steps, self._coordination.ended])
        run_until(self._env, ended, self._setup.seed, self._replicate)
        awake = self._nodes.duty_cycles.awake_fraction(self._env.now)
        self._energy_steps.end(self._clock.step)
        self._energy_steps.write(self._replicate, self._setup.dt, self._recorder)
        return NetworkOutcome(
            self._nodes,
            self._counters,
            self._event_log.fingerprint(),
            awake,
            cycles=self._processors.operations,
            steps=self._clock.step,
            tracks=self._tracks,
            woken=self._wake_up_counters.woken,
            received=self._reports.received,
        )

    def _run_steps(self, progress: Callable[[float], None] | None) -> Generator[simpy.Event, Any, None]:
        env, setup, clock = self._env, self._setup, self._clock
        for step in range(setup.steps + 1):
            if step:
                self._energy_steps.close(step - 1)
            clock.step = self._event_log.step = step
            self._event_log.flush()
            for track in self._tracks:
                self._log_crossing(track.target, step)
                self._sensing.update(track.target)
            for track in self._tracks:
                self._tick(track)
            if progress:
                progress(env.now)
            for poll in range(1, setup.polls if step < setup.steps else 1):  # no search after the end
                yield env.timeout((step + poll / setup.polls) * setup.dt - env.now)
                for track in self._tracks:
                    self._coordination.fill_vacancy(track, poll)
            yield env.timeout((step + 1) * setup.dt - env.now)

    def _log_crossing(self, target: int, step: int) -> None:
        """Log that a target left the field or came back."""
        inside = self._in_field[target]
        if inside[step] != (inside[step - 1] if step else True):
            self._log.add("return" if inside[step] else "leave", target, -1)

    def _tick(self, track: Track) -> None:
        """Start the step of the track's head; find a head first if there is none."""
        self._wake_up_counters.count_rounds(track)
        tick, track.tick = track.tick, self._env.event()
        track.heads.append(-1 if track.head is None else track.head)
        self._coordination.fill_vacancy(track, 0)
        tick.succeed()

    def _handle_death(self, node: int) -> None:
        """Take down a node whose battery is empty, whatever it is doing."""
        self._nodes.died_at[node] = self._env.now
        self._log.add("death", -1, node)
        self._take_down(node)

    def _crash(self, node: int) -> None:
        """Take down a node: end what it does, and forget what it knows."""
        self._stack.mac.silence(node)
        self._nodes.crash(node)
        if node in self._nodes.died_at:
            return
        self._take_down(node)
        self._processes.forget(node)
        self._coordination.forget(node)

    def _restart(self, node: int) -> None:
        """Bring back a node that was down, at rest and without a role."""
        self._nodes.restart(node)
        self._router.restore()
        self._sensing.restart(node)

    def _take_down(self, node: int) -> None:
        """End what a node that is no longer up was doing: relaying, sending, sensing, electing, leading a track."""
        self._router.remove(node)
        self._stack.mac.silence(node)
        self._sensing.remove(node)
        self._coordination.withdraw(node)
        self._processes.stop(node)


def _ignore_wake(node: int, target: int, by_frame: bool) -> None:
    """Do nothing: wake-ups by messages are counted by round."""
