"""What a head does: form its cluster, run the tracker step by step, and hand over when the cluster no longer suffices.

Jiang (2013), section 2.3. One SimPy process a head and target; it ends when the head has handed over, or died.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import simpy

from wsnsim.base.arrays import planar
from wsnsim.base.asks import PACKET_BITS, Parcel
from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.rows import Issued, write_particles
from wsnsim.network.air import letter
from wsnsim.network.cluster import Cluster
from wsnsim.network.driver import Driver, HeadDied
from wsnsim.network.formation import first_estimate, recruit, vote
from wsnsim.network.mission import Crew, Mission, TrackLost
from wsnsim.network.stage import Stage
from wsnsim.network.track import ClusterRecord, Track

Waiting = Generator[simpy.Event, Any, Any]


def lead(stage: Stage, crew: Crew, track: Track, head: int, mission: Mission) -> Waiting:
    """A head's life for one target, from taking over until handing on."""
    try:
        if not mission.at_once:
            yield track.tick
        yield from _lead(stage, crew, track, head, mission)
    except (HeadDied, simpy.Interrupt):
        if track.head == head:
            _give_up(stage, crew, track, "head_died")
    except TrackLost as lost:
        _give_up(stage, crew, track, str(lost))
    except WsnsimError:
        raise
    except Exception as reason:  # the engine makes exceptions anew from their arguments, which not every class can bear
        raise RunError(f"{type(reason).__name__}: {reason}") from reason
    if track.head != head:
        crew.dismiss(track, head)


def _lead(stage: Stage, crew: Crew, track: Track, head: int, mission: Mission) -> Waiting:
    cluster = yield from _form(stage, crew, track, head, mission)
    if cluster is None:
        return
    driver = Driver(stage, track.target, head, cluster.members)
    tracker = stage.parts.tracker
    belief, last = mission.belief, mission.belief_step
    if mission.readings is not None:
        scene = cluster.scene(0)
        prior, readings = yield from first_estimate(stage, track, head, mission)
        belief = yield from driver.perform(tracker.start(prior, scene))
        driver.readings = readings
        _count_start(stage, track, head)
        _issue(stage, track, last, scene, driver, tracker.estimate(belief))
        yield track.tick
    waits_for = _patience(stage, track, cluster)
    while True:
        scene = cluster.scene(stage.step - last)
        last = stage.step
        belief = yield from driver.perform(tracker.step(belief, scene))
        _issue(stage, track, last, scene, driver, tracker.estimate(belief))
        if stage.recorder.wants("particles"):
            _snapshot(stage, track, cluster, belief, last)
        if waits_for is not None and waits_for != set(stage.sensing[track.target]):
            waits_for = None
        if waits_for is None and stage.parts.clusters.must_hand_over(cluster.active(), cluster.size):
            yield from _hand_over(stage, crew, track, cluster, belief, scene)
            return
        yield track.tick


def _form(
    stage: Stage, crew: Crew, track: Track, head: int, mission: Mission
) -> Generator[simpy.Event, Any, Cluster | None]:
    """Announce, let those who sense and hear join; None if a network-wide election gave the lead to another node."""
    policy, target = stage.parts.clusters, track.target
    joined: list[int] = []
    if not policy.is_open:
        joined = yield from recruit(stage, track, head)
    cluster = Cluster(stage, target, head, joined, policy.is_open)
    too_few = not policy.is_open and cluster.active() < policy.minimum_active
    if too_few and not mission.elected and mission.readings is None:
        winner = yield from vote(stage, crew, track)
        mission.elected = True
        if winner is not None and winner != head:
            yield from _pass_on(stage, crew, track, cluster, winner, mission)
            return None
    for node in [node for node in cluster.members if not stage.fleet.alive[node]]:
        cluster.forget(node)
    record = ClusterRecord(len(track.clusters), head, mission.previous_head, stage.env.now, cluster.size)
    record.hops, record.handover_bits = mission.hops, mission.bits
    track.clusters.append(record)
    track.cluster = cluster
    crew.enlist(track, cluster)
    return cluster


def _count_start(stage: Stage, track: Track, head: int) -> None:
    """A track has started; if it was on before, it has been re-acquired."""
    if track.started:
        track.reacquired += 1
        stage.log("reacquire", track.target, head)
    track.started = True


def _pass_on(stage: Stage, crew: Crew, track: Track, cluster: Cluster, winner: int, mission: Mission) -> Waiting:
    """Send a belief that was never dealt out to the node that won the election; it acts in this very step."""
    driver = Driver(stage, track.target, cluster.head, cluster.members)
    scene = cluster.scene(stage.step - mission.belief_step)
    flow = stage.parts.tracker.hand_over(mission.belief, scene, winner)
    yield from _send_belief(stage, crew, track, driver, flow, winner, mission)


def _hand_over(stage: Stage, crew: Crew, track: Track, cluster: Cluster, belief: Any, scene: Scene) -> Waiting:
    """Find the successor, send it what there is, and dissolve the cluster; it leads from the next tick on."""
    parts, target = stage.parts, track.target
    if parts.until_clusters is not None and len(track.clusters) >= parts.until_clusters:
        crew.end_run()
        return
    forecast = parts.tracker.forecast(belief, scene, stage.step - scene.step + 1)
    point = planar(forecast.mean[list(parts.filter_motions[target].position)])
    successor = parts.clusters.successor(point, stage.fleet.positions, stage.fleet.able(stage.threshold))
    mission = Mission(scene.step, previous_head=cluster.head)
    track.handovers += 1
    if successor is not None and parts.clusters.calls_election:
        successor = yield from _wake_and_vote(stage, crew, track, cluster.head, successor)
        mission.elected = True
    if successor is None:
        raise TrackLost("no_successor")
    stage.log("handover", target, cluster.head, peer=successor)
    driver = Driver(stage, target, cluster.head, cluster.members)
    flow = parts.tracker.hand_over(belief, scene, successor)
    yield from _send_belief(stage, crew, track, driver, flow, successor, mission)


def _wake_and_vote(
    stage: Stage, crew: Crew, track: Track, head: int, near: int
) -> Generator[simpy.Event, Any, int | None]:
    """Wake the node nearest to the forecast; at the next tick it calls an election, which the head awaits.

    The paper leaves open how the head learns of the winner: here it does, without a frame (our choice).
    """
    wake = letter(head, near, Parcel(None, 1, PACKET_BITS, "wake"))
    yield stage.air.carry([wake], track.target)
    if not wake.arrived:
        return None
    yield track.tick
    winner = yield from vote(stage, crew, track)
    if winner is not None:
        return winner
    return near if stage.fleet.alive[near] else None


def _send_belief(
    stage: Stage, crew: Crew, track: Track, driver: Driver, flow: Any, successor: int, mission: Mission
) -> Waiting:
    belief = yield from driver.perform(flow)
    _dissolve(stage, crew, track)
    if belief is None or not stage.fleet.alive[successor]:
        raise TrackLost("handover_lost")
    handed_on = replace(mission, belief=belief, at_once=mission.elected)
    handed_on.hops, handed_on.bits = mission.hops + driver.hops, mission.bits + driver.bits
    crew.appoint(track, successor, handed_on)


def _dissolve(stage: Stage, crew: Crew, track: Track) -> None:
    """The cluster's members are free; what they remember of it is forgotten."""
    if track.cluster is not None:
        track.clusters[-1].released = stage.env.now
        crew.release(track, track.cluster)
        track.cluster = None


def _give_up(stage: Stage, crew: Crew, track: Track, why: str) -> None:
    """The belief is gone: say so, and leave the track to the next election."""
    stage.log("lost", track.target, -1 if track.head is None else track.head, why)
    _dissolve(stage, crew, track)
    track.head = None


def _patience(stage: Stage, track: Track, cluster: Cluster) -> set[int] | None:
    """Who senses now, if the cluster is too small: it stays until others do, or it would hand over at each step.

    Our choice, and an idealisation: the head knows of nodes that are not its members.
    """
    policy = stage.parts.clusters
    if policy.is_open or cluster.active() >= policy.minimum_active:
        return None
    return set(stage.sensing[track.target])


def _issue(stage: Stage, track: Track, step: int, scene: Scene, driver: Driver, estimate: Estimate) -> None:
    """Record the estimate of a step. What is believed at step 0 is the prior, and no estimate."""
    if step == 0:
        return
    stage.log("estimate", track.target, scene.head)
    assert math.isfinite(sum(estimate.mean.tolist())), (
        f"the tracker's estimate at step {step} is not finite: {estimate.mean}"
    )
    track.estimates[step] = Issued(
        step, stage.env.now, estimate, scene.head, scene.active, len(scene.roster), driver.readings
    )
    stage.reports.send(scene.head, step, track.target)


def _snapshot(stage: Stage, track: Track, cluster: Cluster, belief: Any, step: int) -> None:
    """Record the particles, wherever they are."""
    members = [cluster.members[node] for node in cluster.roster()]
    held = stage.parts.tracker, belief, members
    columns = stage.parts.motions[track.target].columns
    write_particles(stage.recorder, stage.replicate, track.target, step, held, columns)
