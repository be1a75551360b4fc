"""One run: the clock, the nodes that wake, the tracks that they keep, and what is written of it.

    World(parts, replicate, positions, traits, truths, prior, streams, recorder).run() -> Outcome

At each step: nodes that came into range wake, all in range sense that are awake, a track that nobody leads calls an
election, and every head is given its tick. Where heads move with the target, nodes that are awake look for a target
that nobody follows, between steps too. The cost follows what is awake and what is sent.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.counters import Counters
from wsnsim.base.errors import RunError
from wsnsim.base.ports import Estimate, Recorder
from wsnsim.base.rng import Streams
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.handover import Crew, Handover
from wsnsim.network.clusters.target_search import TargetSearch
from wsnsim.network.clusters.track import Election, Track, ballot_box
from wsnsim.network.clusters.wake_up_service import WakeUpService
from wsnsim.network.energy.energy_steps import EnergySteps
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.fault_services import FaultSite, NodeControl
from wsnsim.network.faults import FaultSchedule
from wsnsim.network.node import Node
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.radio_stack import make_radio_stack, run_until
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.transport import Transport
from wsnsim.network.readings import make_senses
from wsnsim.network.run_context import RunContext
from wsnsim.network.sink_reports import SinkReports

SENSE: Final = KIND["sense"]
MECHANISMS: Final = ("none", "flood", "region", "invite")
"""Ways to wake nodes."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run leaves behind.

    `woken` (targets, steps + 1, 2): nodes that woke, and those of them in vain; `received`: when the sink had the
    estimate of (target, step). `awake`: the share of the nodes' time that they were awake.
    """

    fleet: Nodes
    tracks: tuple[Track, ...]
    woken: Ints
    received: Mapping[tuple[int, int], float]
    steps: int
    counts: Counters
    cycles: float
    event_fingerprint: int
    awake: float


class World:
    """One network, its targets, and the clock."""

    def __init__(
        self,
        parts: NetworkSetup,
        replicate: int,
        positions: Floats,
        traits: Floats,
        truths: Sequence[Floats],
        priors: Sequence[Estimate],
        streams: Streams,
        recorder: Recorder,
        paths: Sequence[Floats] = (),
    ) -> None:
        """`paths`: the truths with `parts.polls` instants a step, left out where there is one."""
        _refuse_the_unknown(parts)
        journal = EventLog(recorder, replicate)
        stack = make_radio_stack(parts, positions, traits, streams, journal)
        radio, clocks, self._mac = stack.radio, stack.clocks, stack.mac
        env, fleet = radio.env, radio.nodes
        self._env, self._counters = env, radio.counters
        fleet.on_death = self._bury
        self._nodes: dict[int, Node] = {}
        self._router = Router(radio, parts.routing.weight, parts.link.audible)
        sensed, imperfections = make_senses(parts, truths, fleet, clocks, streams.key("sense"))
        air = Transport(radio, self._mac, self._router)
        self._stage = RunContext(
            env=env,
            parts=parts,
            fleet=fleet,
            journal=journal,
            air=air,
            reports=SinkReports(radio, air, parts.sink, parts.dt),
            clocks=clocks,
            sensed=sensed,
            field=parts.deploy.field,
            threshold=parts.head_threshold,
            tracker_key=streams.key("tracker"),
            replicate=replicate,
            recorder=recorder,
            sensing=[{} for _ in truths],
        )
        self._costs = EnergySteps(env, fleet, recorder)
        self._wake_up(air, streams)
        self._search = TargetSearch(self._stage, paths or truths, streams, sensed, imperfections)
        self._points = [truth[:, list(motion.position)] for truth, motion in zip(truths, parts.motions, strict=True)]
        self._inside = [parts.deploy.field.contains(planar(points)).tolist() for points in self._points]
        self._tracks = tuple(Track(target, prior, env.event()) for target, prior in enumerate(priors))
        self._crew = Crew(
            self._appoint, self._call_election, self._enlist, self._release, self._dismiss, self._woke, self._end_run
        )
        control = NodeControl(self._crash, self._restart, self._head_of)
        site = FaultSite(env, fleet, journal, clocks, control, imperfections.defects)
        self._faults = FaultSchedule(parts.faults, site, streams.key("faults"), parts.dt)
        self._ended = env.event()
        self._woken = np.zeros((len(truths), parts.steps + 1, 2), dtype=np.int64)

    def run(self, progress: Callable[[float], None] | None = None) -> Outcome:
        """Run to the end. A failure names seed, replicate and simulated time."""
        stage = self._stage
        self._faults.start()
        clock = self._env.process(self._clock(progress))
        run_until(self._env, self._env.any_of([clock, self._ended]), stage.parts.seed, stage.replicate)
        awake = stage.fleet.awake_fraction(self._env.now)
        self._costs.end(stage.step)
        self._costs.write(stage.replicate, stage.parts.dt, stage.recorder)
        return Outcome(
            stage.fleet, self._tracks, self._woken, stage.reports.received, stage.step, self._counters, stage.cycles,
            stage.journal.fingerprint(), awake,
        )  # fmt: skip

    def _clock(self, progress: Callable[[float], None] | None) -> Generator[simpy.Event, Any, None]:
        stage, dt = self._stage, self._stage.parts.dt
        for step in range(stage.parts.steps + 1):
            if step:
                self._costs.close(step - 1)
            stage.step = stage.journal.step = step
            stage.journal.flush()
            for track in self._tracks:
                self._sense(track.target, step)
            for track in self._tracks:
                self._tick(track)
            if progress:
                progress(self._env.now)
            for part in range(1, stage.parts.polls if step < stage.parts.steps else 1):
                yield self._env.timeout((step + part / stage.parts.polls) * dt - self._env.now)
                for track in self._tracks:
                    self._look_for(track, part)
            yield self._env.timeout((step + 1) * dt - self._env.now)

    def _sense(self, target: int, step: int) -> None:
        """Wake who came into range, let go who left it, and take everybody's reading."""
        stage, sensed, alive = self._stage, self._stage.sensed[target], self._stage.fleet.alive
        self._watch_field(target, step)
        if stage.fleet.follows_schedules or stage.parts.clusters.moves:
            self._sense_awake(target, sensed.readings(step))
            if stage.parts.clusters.moves:
                return
        else:
            for index in sensed.vanished(step):
                if alive[index]:
                    self._node(index).lose_target(target)
            for index in sensed.appeared(step):
                if alive[index]:
                    self._node(index).hear_target(target)
        joules = stage.parts.energy.sense()
        cause = EVENT_CAUSE["sense" if joules else "none"]
        readings = stage.sensing[target] if stage.fleet.follows_schedules else sensed.readings(step)
        if not stage.fleet.all_listen:
            readings = {index: value for index, value in readings.items() if alive[index]}
        paid = dict.fromkeys(readings, 0.0)
        if joules:
            paid = {index: stage.fleet.spend(index, CAUSE["sense"], joules) for index in readings}
            paid = {index: spent for index, spent in paid.items() if spent}
            readings = {index: value for index, value in readings.items() if alive[index]}
        now = self._env.now
        stage.journal.extend(
            [event(now, step, target, index, SENSE, joules=spent, cause=cause) for index, spent in paid.items()]
        )
        stage.sensing[target] = readings

    def _sense_awake(self, target: int, readings: dict[int, float]) -> None:
        """Where nodes sleep, or heads move: who is awake senses. In standing clusters it stays awake while it does."""
        stage, before = self._stage, self._stage.sensing[target]
        now = {index: value for index, value in readings.items() if stage.fleet.is_awake(index)}
        stage.sensing[target] = now
        if stage.parts.clusters.moves:
            return
        for index in before:
            if index not in now and stage.fleet.alive[index]:
                self._node(index).lose_target(target)
        for index in now:
            if index not in before:
                self._node(index).hear_target(target)

    def _watch_field(self, target: int, step: int) -> None:
        """Say when a target leaves the field, and when it is back."""
        inside, before = self._inside[target][step], self._inside[target][step - 1] if step else True
        if inside != before:
            self._stage.log("return" if inside else "leave", target, -1)

    def _tick(self, track: Track) -> None:
        """Give the track's head its tick; where nobody leads, let those who sense elect one."""
        self._count_woken(track)
        tick, track.tick = track.tick, self._env.event()
        track.heads.append(-1 if track.head is None else track.head)
        if self._stage.parts.clusters.moves:
            self._look_for(track, 0)
        elif track.head is None and track.election is None:
            self._fill_vacancy(track)
        tick.succeed()

    def _count_woken(self, track: Track) -> None:
        """Who was woken for this step, and who of them in vain, with the target beyond reach."""
        stage, point = self._stage, planar(self._points[track.target][self._stage.step])
        woken: set[int] = set()
        vain: set[int] = set()
        for waking in track.wakings_for(stage.step):
            tracking = [node for node in waking.tracking if stage.fleet.alive[node]]
            apart = stage.fleet.positions[np.array(tracking, dtype=np.int64)] - point
            beyond = np.hypot(apart[:, 0], apart[:, 1]) > stage.parts.sensor.reach
            waking.woken, waking.ineffective = len(tracking), int(beyond.sum())
            waking.dismissed = len(waking.rung.difference(waking.tracking))
            woken.update(tracking)
            vain.update(itertools.compress(tracking, beyond.tolist()))
        self._woken[track.target, stage.step] += (len(woken), len(vain))

    def _look_for(self, track: Track, part: int) -> None:
        """Where nobody follows the target, let the first node that is awake and detects it take it up."""
        if track.head is not None:
            return
        found = self._search.first(track.target, part)
        if found is not None:
            head, detected = found
            self._appoint(track, head, Handover(self._stage.step, at_once=True, detected=detected))

    def _fill_vacancy(self, track: Track) -> None:
        stage, policy = self._stage, self._stage.parts.clusters
        if policy.is_open:
            able = stage.fleet.able(stage.threshold)
            head = policy.successor(np.zeros(2), stage.fleet.positions, able)
            if head is not None and (stage.sensing[track.target] or stage.step == 0):
                self._appoint(track, head, Handover(stage.step, readings={}, elected=True, at_once=True))
            return
        election = ballot_box(stage, track, fills_vacancy=True)
        if election.strengths:
            self._call_election(track, election)

    def _node(self, index: int) -> Node:
        """The node's process, born when first needed."""
        node = self._nodes.get(index)
        if node is None:
            node = self._nodes[index] = Node(self._stage, self._crew, index)
        return node

    def _wake_up(self, air: Transport, streams: Streams) -> None:
        """Make what wakes nodes, if anything does, and keep the sink awake."""
        stage = self._stage
        if stage.parts.wakeup.mechanism != "none":
            stage.waker = WakeUpService(
                stage,
                streams.key("wakeup"),
                lambda node, target, until, why: self._node(node).watch(target, until, why),
                lambda node, target: self._node(node).relax(target) if node in self._nodes else None,
            )
            air.wake_neighbour = stage.waker.rouse
        if stage.reports.node is not None:
            stage.fleet.keep_awake(stage.reports.node)

    def _appoint(self, track: Track, head: int, mission: Handover) -> None:
        track.head = head
        self._node(head).take_lead(track, mission)

    def _call_election(self, track: Track, election: Election) -> None:
        track.election = election
        assert election.closed.callbacks is not None
        election.closed.callbacks.append(lambda _: setattr(track, "election", None))
        for index in election.strengths:
            self._node(index).stand(track, election)

    def _enlist(self, track: Track, cluster: Cluster) -> None:
        if not self._stage.parts.clusters.is_open:
            for index in cluster.members:
                self._node(index).serve(track.target)

    def _release(self, track: Track, cluster: Cluster) -> None:
        policy = self._stage.parts.clusters
        if not policy.is_open and not policy.moves:
            for index in cluster.roster():
                self._node(index).dismiss(track.target)

    def _dismiss(self, track: Track, index: int) -> None:
        self._node(index).dismiss(track.target)

    def _woke(self, index: int, target: int, by_frame: bool) -> None:
        """Count a wake at its step; one by a frame is ineffective where the target is out of range.

        Where nodes are woken for the next step, they are counted there: see `_count_woken`.
        """
        if self._stage.waker is not None:
            return
        in_vain = by_frame and index not in self._stage.sensing[target]
        self._woken[target, self._stage.step] += (1, in_vain)

    def _end_run(self) -> None:
        if not self._ended.triggered:
            self._ended.succeed()

    def _bury(self, index: int) -> None:
        """A charge has reached zero: the node is gone at this instant, whatever it did."""
        stage = self._stage
        stage.fleet.died_at[index] = self._env.now
        stage.log("death", -1, index)
        self._take_down(index)

    def _crash(self, index: int) -> None:
        """A node that has not run dry goes down: what it did ends, what it knew is forgotten."""
        fleet = self._stage.fleet
        self._mac.silence(index)
        fleet.crash(index)
        if index in fleet.died_at:
            return
        self._take_down(index)
        self._nodes.pop(index, None)
        for track in self._tracks:
            if track.cluster is not None:
                track.cluster.forget(index)

    def _restart(self, index: int) -> None:
        """A node that was down comes back at rest, without a role; a target that is in range by now wakes it."""
        stage = self._stage
        stage.fleet.restart(index)
        self._router.restore()
        for target, sensed in enumerate(stage.sensed):
            hears = not stage.fleet.follows_schedules and not stage.parts.clusters.moves
            if hears and index in sensed.readings(stage.step):
                self._node(index).hear_target(target)

    def _head_of(self, target: int) -> int | None:
        return self._tracks[target].head if target < len(self._tracks) else None

    def _take_down(self, index: int) -> None:
        """Whoever is no longer up neither sends nor relays, senses nothing, stands for nothing, and leads nobody."""
        stage = self._stage
        self._router.remove(index)
        self._mac.silence(index)
        for track in self._tracks:
            stage.sensing[track.target].pop(index, None)
            if track.election is not None and index in track.election.strengths:
                track.election.withdraw(index)
        if index in self._nodes:
            self._nodes[index].die()


def _refuse_the_unknown(parts: NetworkSetup) -> None:
    """A part that this network would have to ignore must not look as if it had been obeyed."""
    if parts.wakeup.mechanism not in MECHANISMS:
        known = ", ".join(MECHANISMS)
        raise RunError(f"wakeup: no mechanism '{parts.wakeup.mechanism}' in this network; known: {known}")
