"""A head that moves with the target: anew at each step there is a main node, and nodes that were told to track.

    pursue(stage, crew, track, head, mission)      a main node's life, until another takes over (see `tenure`)

At the step's instant the nodes that were woken for it take their readings and send them to the main node, which waits
until none has come for a while, estimates, reports, and has nodes woken for the next step. Who leads then is the one
of these nearest to the prediction, or the one that has read the target nearest. Nobody follows a target that was lost:
nodes that happen to be awake look for it, and the first to detect it becomes main node.

Li, Jiang, Zhang, Zhang (2012), section 2.2, and the reconstructions of its two rivals. Idealisations, all our choice:
those who track know who of them is nearest to the prediction, and nodes that are awake know whether a target is
followed already.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import simpy

from wsnsim.base.ports import MovingPolicy, Portable, Ranks, Scene
from wsnsim.base.requests import Parcel
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver, HeadDied
from wsnsim.network.clusters.handover import Crew, Handover, TrackLost
from wsnsim.network.clusters.head_life_cycle import Waiting, count_start, dissolve, enter_office, issue, snapshot
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_ahead import look_ahead, predicted
from wsnsim.network.radio.transport import Datagram
from wsnsim.network.run_context import RunContext

TINY = 1e-9


@dataclass(slots=True)
class _Office:
    """A main node's time: its belief, of step `last` and time `since`; when it last had a reading; what it works with.

    `scene`: of the last step. A target that was found between two steps has a first step shorter than others.
    """

    stage: RunContext
    crew: Crew
    track: Track
    head: int
    policy: MovingPolicy
    belief: Any
    last: int
    since: float
    fixed_at: float
    scene: Scene | None = None
    heard: Mapping[int, float] | None = None


def pursue(stage: RunContext, crew: Crew, track: Track, head: int, mission: Handover) -> Waiting:
    """A main node's life for one target, from taking over until another does."""
    policy = cast(MovingPolicy, stage.parts.clusters)
    since = mission.belief_time if mission.belief_time is not None else mission.belief_step * stage.parts.dt
    office = _Office(stage, crew, track, head, policy, mission.belief, mission.belief_step, since, mission.fixed_at)
    enter_office(stage, track, _cluster(stage, track, head, []), mission)
    if mission.detected is not None:
        yield from _take_up(office, mission.detected)
        if (yield from _move_on(office)):
            return
    elif mission.looks_ahead:
        office.scene = _cluster(stage, track, head, []).scene(0)
        office.scene.time, office.scene.dt = office.since, (stage.step + 1) * stage.parts.dt - office.since
        look_ahead(stage, track, head, office.belief, office.scene, office.fixed_at)
        yield track.tick
        if (yield from _give_way(office)):
            return
    while True:
        yield from _step(office)
        if (yield from _move_on(office)):
            return


def _cluster(stage: RunContext, track: Track, head: int, joined: list[int]) -> Cluster:
    return Cluster(stage, track.target, head, joined, is_open=False, keys_ahead=1)


def _take_up(office: _Office, detected: Mapping[int, float]) -> Waiting:
    """Tell the neighbours of a target that nobody follows; who senses it, too, answers. The track starts from that.

    `detected`: {node: reading} of all who are awake and sense the target at this instant.
    """
    stage, track, head = office.stage, office.track, office.head
    began, step, acquire = stage.env.now, stage.step, stage.parts.acquire
    for node in detected:
        stage.log("sense", track.target, node)
    yield stage.env.timeout(office.policy.sampling)
    listeners = yield from _ask(office, "detection")
    answers = [Datagram(node, head, Parcel(detected[node], 1, acquire.answer_bits, "reading"))
               for node in listeners if node in detected]  # fmt: skip
    cluster = _cluster(stage, track, head, [item.source for item in answers])
    driver = _driver(office, cluster)
    yield from driver.collect(answers)
    readings = {head: detected[head], **{item.source: detected[item.source] for item in answers if item.arrived}}
    nodes = np.array(sorted(readings), dtype=np.int64)
    prior = acquire.estimate(
        np.array([readings[node] for node in nodes.tolist()]), stage.fleet.positions[nodes], stage.fleet.traits[nodes],
        stage.parts.filter_sensor, stage.parts.filter_motions[track.target], track.prior,
    )  # fmt: skip
    office.scene = cluster.scene(0)
    office.scene.time, office.scene.dt = began, (step + 1) * stage.parts.dt - began
    office.belief = yield from driver.perform(stage.parts.tracker.start(prior, office.scene))
    driver.readings = len(readings)
    office.heard, office.fixed_at, office.last, office.since = readings, began, step, began
    count_start(stage, track, head)
    if abs(began - step * stage.parts.dt) < TINY:
        issue(stage, track, step, office.scene, driver, stage.parts.tracker.estimate(office.belief))


def _step(office: _Office) -> Waiting:
    """One step at the main node: readings in, an estimate out."""
    stage, track, head = office.stage, office.track, office.head
    began = stage.env.now
    told, nobody_is_told = _told(office), stage.waker is None
    _sample(stage, track, list(stage.sensing[track.target]) if nobody_is_told else [head, *told])
    yield stage.env.timeout(office.policy.sampling)
    if nobody_is_told:
        listeners = yield from _ask(office, "request")
        told = [node for node in listeners if node in stage.sensing[track.target]]
    cluster = track.cluster = _cluster(stage, track, head, told)
    track.clusters[-1].members = max(track.clusters[-1].members, cluster.size)
    driver = _driver(office, cluster)
    step = stage.step
    office.scene = scene = cluster.scene(step - office.last)
    scene.dt = (scene.time - office.since) / scene.steps if scene.steps else scene.dt
    office.belief = yield from driver.perform(stage.parts.tracker.step(office.belief, scene))
    office.last, office.since, office.heard = step, scene.time, driver.heard
    scene.dt = stage.parts.dt
    if driver.readings:
        office.fixed_at = began
        issue(stage, track, step, office.scene, driver, stage.parts.tracker.estimate(office.belief))
        snapshot(stage, track, cluster, office.belief, step)
    elif began - office.fixed_at > office.policy.patience + TINY:
        raise TrackLost("no_readings")


def _told(office: _Office) -> list[int]:
    """Who tracks at this step, having been told, and can."""
    waking, stage = office.track.waking, office.stage
    if waking is None or waking.message.step != stage.step:
        return []
    return [node for node in sorted(waking.tracking) if node != office.head and stage.fleet.alive[node]]


def _ask(office: _Office, what: str) -> Generator[simpy.Event, Any, list[int]]:
    """Broadcast a word about the target; who heard it."""
    stage, head = office.stage, office.head
    bits = stage.parts.acquire.detection_bits
    event, (frame,) = stage.air.broadcast([head], [Parcel(None, 1, bits, what)], office.track.target)
    yield event
    if not stage.fleet.alive[head]:
        raise HeadDied
    return [node for node in sorted(frame.received) if stage.fleet.alive[node]]


def _driver(office: _Office, cluster: Cluster) -> Driver:
    window = office.policy.quiet, office.policy.cap
    return Driver(office.stage, office.track.target, office.head, cluster.members, window)


def _sample(stage: RunContext, track: Track, nodes: list[int]) -> None:
    """Note who of the nodes that take a reading gets one. Who is awake looks all the time: it is paid for already."""
    for node in nodes:
        if node in stage.sensing[track.target]:
            stage.log("sense", track.target, node)


def _move_on(office: _Office) -> Generator[simpy.Event, Any, bool]:
    """Have nodes woken for the next step, and wait for it; whether another main node has taken over.

    Where the next main node wakes them, it is told at once; else the present one wakes them, and gives way at the step.
    """
    stage, track, head = office.stage, office.track, office.head
    assert office.scene is not None, "a step, or an acquisition, went before"
    if stage.parts.wakeup.mechanism == "region" and office.policy.main == "prediction":
        successor = _nearest(stage, predicted(stage, track, office.belief, office.scene))
    elif office.policy.main == "detection":
        successor = _loudest(office)
    else:
        successor = head
    if successor is None:
        raise TrackLost("empty_region")
    if successor != head:
        yield from _hand_over(office, successor, looks_ahead=True)
        return True
    look_ahead(stage, track, head, office.belief, office.scene, office.fixed_at)
    yield track.tick
    return (yield from _give_way(office))


def _give_way(office: _Office) -> Generator[simpy.Event, Any, bool]:
    """At the step's instant: whether another of those who were woken for it is main node now."""
    stage, track = office.stage, office.track
    waking = track.waking
    if office.policy.main != "prediction" or waking is None or waking.message.step != stage.step:
        return False
    able = [node for node in sorted(waking.tracking) if stage.able(node)]
    if not able:
        raise TrackLost("expired" if waking.expired else "nobody_woken")
    positions = stage.fleet.positions[np.array(able)]
    away = ((positions - np.array(waking.message.centre)) ** 2).sum(axis=1)
    successor = able[int(np.argmin(away))]
    if successor == office.head:
        return False
    if stage.parts.wakeup.carries_belief and isinstance(stage.parts.tracker, Portable):
        stage.log("handover", track.target, office.head, "message", peer=successor)
        _appoint(office, Handover(office.last, waking.tracking[successor].belief, at_once=True), successor)
    else:
        yield from _hand_over(office, successor, looks_ahead=False)
    return True


def _nearest(stage: RunContext, point: Any) -> int | None:
    """The living node nearest to a point, if it is in the sensors' reach of it."""
    near = stage.fleet.tree.query_ball_point(point, stage.parts.sensor.reach)
    able = [node for node in near if stage.able(node)]
    if not able:
        return None
    away = ((stage.fleet.positions[np.array(able)] - point) ** 2).sum(axis=1)
    return min(zip(away.tolist(), able, strict=True))[1]


def _loudest(office: _Office) -> int:
    """Who has read the target nearest of those whose readings came; the main node itself if none came."""
    stage, sensor = office.stage, office.stage.parts.sensor
    able = {node: reading for node, reading in (office.heard or {}).items() if stage.able(node)}
    if not able:
        return office.head
    strength = sensor.strength if isinstance(sensor, Ranks) else float
    return min(able, key=lambda node: (-strength(able[node]), node))


def _hand_over(office: _Office, successor: int, looks_ahead: bool) -> Waiting:
    """Send the belief to the next main node. If it does not arrive, the track is lost."""
    stage, track, head = office.stage, office.track, office.head
    assert office.scene is not None, "a step, or an acquisition, went before"
    driver = _driver(office, _cluster(stage, track, head, []))
    stage.log("handover", track.target, head, peer=successor)
    belief = yield from driver.perform(stage.parts.tracker.hand_over(office.belief, office.scene, successor))
    if belief is None or not stage.fleet.alive[successor]:
        raise TrackLost("handover_lost")
    mission = Handover(office.last, belief, at_once=True, looks_ahead=looks_ahead)
    mission.hops, mission.bits = driver.hops, driver.bits
    _appoint(office, mission, successor)


def _appoint(office: _Office, mission: Handover, successor: int) -> None:
    stage, track, crew = office.stage, office.track, office.crew
    until = stage.parts.until_clusters
    if until is not None and len(track.clusters) >= until:
        crew.end_run()
        return
    track.handovers += 1
    mission.previous_head, mission.fixed_at, mission.belief_time = office.head, office.fixed_at, office.since
    dissolve(stage, crew, track)
    crew.appoint(track, successor, mission)
