"""A network that tracks targets: its nodes, its tracks and the order of what happens in a step.

    World(setup, replicate, conditions, paths, streams, recorder).run() -> NetworkOutcome

At each step the nodes in range of a target wake and sense, a track without a head gets one, and every head starts its
step. With moving heads, awake nodes also search for lost targets between steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.rng import Streams
from wsnsim.base.rows import TrackNow, write_readings
from wsnsim.base.runs import OnTime
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import Recorder
from wsnsim.network.base_network import BaseNetwork
from wsnsim.network.clusters.collection import LateReadings
from wsnsim.network.clusters.coordination import ClusterCoordination
from wsnsim.network.clusters.driver import DriverServices, Processors
from wsnsim.network.clusters.head_services import Estimates
from wsnsim.network.clusters.network_view import NetworkView, TargetSearch, WakeIntervals
from wsnsim.network.clusters.track import Track, TrackBook
from wsnsim.network.clusters.wake_ahead import WakeAhead, WakeUpCounters
from wsnsim.network.clusters.wake_up_service import WakeUpService
from wsnsim.network.event_log import Acting, ProtocolLog
from wsnsim.network.imperfect_readings import Imperfections, make_readings
from wsnsim.network.node_process import NodeProcesses
from wsnsim.network.result_rows import NetworkOutcome, write_clusters
from wsnsim.network.scans import UNNAMED, ReadingsOfAll, Scans, write_detections
from wsnsim.network.sensing import CurrentReadings, Readings, SensingServices, make_sensing


class World(BaseNetwork):
    """One network, its targets and the order of events in a step.

    `paths` are the trajectories of the targets at the `setup.polls` instants of a step at which nodes search.
    """

    _setup: NetworkSetup

    def __init__(
        self,
        setup: NetworkSetup,
        replicate: int,
        conditions: InitialConditions,
        paths: Sequence[Floats],
        streams: Streams,
        recorder: Recorder,
    ) -> None:
        super().__init__(setup, replicate, conditions, streams, recorder)
        nodes, clock, log, transport = self._nodes, self._clock, self._event_log, self._transport
        self._log = ProtocolLog(clock, log)
        known = [bool(np.isfinite(truth[0, 0])) for truth in conditions.truths]
        self._tracks = [Track(i, prior, self._env.event(), known[i]) for i, prior in enumerate(conditions.priors)]
        self._book: TrackBook | None = None
        if setup.unlabelled:
            priors = [prior for prior, there in zip(conditions.priors, known, strict=True) if there]
            self._book = TrackBook(self._log, self._env, partial(write_clusters, replicate, recorder), priors)
            self._tracks = self._book.groups
        points = [
            truth[:, list(motion.position)] for truth, motion in zip(conditions.truths, setup.motions, strict=True)
        ]
        self._in_field = [setup.deploy.field.contains(planar(path)).tolist() for path in points]
        clocks, key = self._stack.clocks, streams.key("sense")
        imperfections = Imperfections(setup.detection, clocks, setup.dt, key, self._defects)
        available = make_readings(setup, conditions.truths, nodes, imperfections, key)
        sensed: dict[int, Readings] = dict(enumerate(available))
        if setup.unlabelled:
            points, sensed = [], {UNNAMED: Scans(setup, available, conditions.truths, nodes, key)}
        readings: CurrentReadings = ReadingsOfAll() if setup.unlabelled else {}
        readings.update({target: {} for target in sensed})
        network = NetworkView(setup, clock, self._log, nodes, readings, setup.head_threshold, streams.key("tracker"))
        self._wake_up_counters = WakeUpCounters(network, points)
        self._processes = NodeProcesses(self._env, nodes, self._log, self._wake_up_counters.count_wake)
        sensing = SensingServices(clock, nodes, self._processes, log, sensed, setup.energy.sense())
        self._sensing, self._sensed = make_sensing(sensing, readings, setup.nodes_search), sensed
        self._intervals = WakeIntervals(setup, clock, nodes, self._stack.mac)
        self._processors = Processors(clock, nodes, log, setup.energy, setup.cpu)
        self._late = LateReadings(dict.fromkeys(range(len(self._tracks)), 0) if setup.uses_late_readings else {})
        self._estimates = Estimates(network, self._reports, self._stack.sinks, recorder, replicate)
        self._coordination = ClusterCoordination(
            self._tracks,
            DriverServices(network, transport, self._processors, self._intervals, self._late),
            self._processes,
            self._estimates,
            WakeAhead(network, self._make_wake_up_service(network, streams.key("wakeup"))),
            TargetSearch(network, available, paths or conditions.truths, imperfections, streams.key("search")),
            self._book,
        )
        for sink in self._stack.sinks:
            nodes.keep_awake(sink)

    def _make_wake_up_service(self, network: NetworkView, key: int) -> WakeUpService | None:
        """Make the service that wakes nodes for heads and destinations for their last hop; None if wake-ups are off."""
        if network.setup.wakeup.mechanism == "none":
            return None
        transport, clocks = self._transport, self._stack.clocks
        service = WakeUpService(network, self._processes, transport, self._intervals, clocks, self._event_log, key)
        transport.hops.wake_neighbour = service.call_one
        return service

    def run(self, progress: OnTime | None = None) -> NetworkOutcome:
        """Run to the end and return the outcome. Errors name the seed, the run and the simulated time."""
        return replace(
            self._run(self._run_steps(progress), self._coordination.ended),
            cycles=self._processors.operations,
            tracks=tuple(self._tracks),
            book=self._book,
            hurried=self._intervals.share(),
            woken=self._wake_up_counters.woken,
            received=self._estimates.received,
            late_readings=self._late.used,
        )

    def _run_steps(self, progress: OnTime | None) -> Acting[None]:
        env, setup = self._env, self._setup
        for step in range(setup.steps + 1):
            self._begin_step(step)
            for target in self._sensed:
                self._sense(target, step)
            self._coordination.begin_groups()
            for track in tuple(self._tracks):
                self._tick(track)
            if progress:
                progress(env.now)
            for poll in range(1, setup.polls if step < setup.steps else 1):  # no search after the last instant
                yield env.timeout((step + poll / setup.polls) * setup.dt - env.now)
                for track in tuple(self._tracks):
                    self._coordination.fill_vacancy(track, poll)
            yield env.timeout((step + 1) * setup.dt - env.now)

    def _sense(self, target: int, step: int) -> None:
        """Take the readings of a target; of all at once, where they name none."""
        if target != UNNAMED:
            self._log_crossing(target, step)
        self._sensing.update(target)
        instant, read = {"step": step, "time": self._env.now}, self._sensing.readings[target]
        available = self._sensed[target]
        if isinstance(available, Scans):
            write_detections(self._recorder, {"replicate": self._replicate, **instant}, available, read)
        else:
            write_readings(self._recorder, {"replicate": self._replicate, "target": target, **instant}, read)

    def _head_of(self, target: int) -> int | None:
        return self._coordination.head_of(target)

    def _tracks_now(self) -> list[TrackNow]:
        tracks = [] if self._book else self._tracks
        return [TrackNow(track.target, track.estimates, track.heads) for track in tracks]

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

    def _log_change(self, kind: str, node: int) -> None:
        self._log.add(kind, -1, node)

    def _crash(self, node: int) -> None:
        super()._crash(node)
        # the crash may have emptied the battery: then the node has died, and was taken down as dead
        if node not in self._nodes.died_at:
            self._processes.forget(node)
            self._coordination.forget(node)

    def _restart(self, node: int) -> None:
        super()._restart(node)
        self._sensing.restart(node)

    def _take_down(self, node: int) -> None:
        """End relaying, sending, sensing, electing and leading a track."""
        super()._take_down(node)
        self._sensing.remove(node)
        self._coordination.withdraw(node)
        self._processes.stop(node)
        self._intervals.forget(node)
