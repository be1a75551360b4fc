"""What a head does: form its cluster, run the tracker step by step, and hand over when the cluster no longer suffices.

Jiang (2013), section 2.3. One SimPy process a head and target (see `tenure`); it ends when the head has handed over,
or died. Heads that move with the target: see `pursuit`.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import simpy

from wsnsim.base.arrays import planar
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.formation import first_estimate, recruit, vote
from wsnsim.network.clusters.handover import Crew, Handover, TrackLost
from wsnsim.network.clusters.head_life_cycle import Waiting, count_start, dissolve, enter_office, issue, snapshot
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_ahead import look_ahead
from wsnsim.network.radio.transport import Datagram
from wsnsim.network.run_context import RunContext


def lead(stage: RunContext, crew: Crew, track: Track, head: int, mission: Handover) -> Waiting:
    """A head's life for one target, from taking over until handing on."""
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
        count_start(stage, track, head)
        issue(stage, track, last, scene, driver, tracker.estimate(belief))
        yield track.tick
    waits_for = _patience(stage, track, cluster)
    while True:
        scene = cluster.scene(stage.step - last)
        last = stage.step
        belief = yield from driver.perform(tracker.step(belief, scene))
        issue(stage, track, last, scene, driver, tracker.estimate(belief))
        snapshot(stage, track, cluster, belief, last)
        look_ahead(stage, track, head, belief, scene)
        if waits_for is not None and waits_for != set(stage.sensing[track.target]):
            waits_for = None
        if waits_for is None and stage.parts.clusters.must_hand_over(cluster.active(), cluster.size):
            yield from _hand_over(stage, crew, track, cluster, belief, scene)
            return
        yield track.tick


def _form(
    stage: RunContext, crew: Crew, track: Track, head: int, mission: Handover
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
    enter_office(stage, track, cluster, mission)
    crew.enlist(track, cluster)
    return cluster


def _pass_on(stage: RunContext, crew: Crew, track: Track, cluster: Cluster, winner: int, mission: Handover) -> Waiting:
    """Send a belief that was never dealt out to the node that won the election; it acts in this very step."""
    driver = Driver(stage, track.target, cluster.head, cluster.members)
    scene = cluster.scene(stage.step - mission.belief_step)
    flow = stage.parts.tracker.hand_over(mission.belief, scene, winner)
    yield from _send_belief(stage, crew, track, driver, flow, winner, mission)


def _hand_over(stage: RunContext, crew: Crew, track: Track, cluster: Cluster, belief: Any, scene: Scene) -> Waiting:
    """Find the successor, send it what there is, and dissolve the cluster; it leads from the next tick on."""
    parts, target = stage.parts, track.target
    if parts.until_clusters is not None and len(track.clusters) >= parts.until_clusters:
        crew.end_run()
        return
    forecast = parts.tracker.forecast(belief, scene, stage.step - scene.step + 1)
    point = planar(forecast.mean[list(parts.filter_motions[target].position)])
    successor = parts.clusters.successor(point, stage.fleet.positions, stage.fleet.able(stage.threshold))
    mission = Handover(scene.step, previous_head=cluster.head)
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
    stage: RunContext, crew: Crew, track: Track, head: int, near: int
) -> Generator[simpy.Event, Any, int | None]:
    """Wake the node nearest to the forecast; at the next tick it calls an election, which the head awaits.

    The paper leaves open how the head learns of the winner: here it does, without a frame (our choice).
    """
    wake = Datagram(head, near, Parcel(None, 1, PACKET_BITS, "wake"))
    yield stage.air.carry([wake], track.target)
    if not wake.arrived:
        return None
    yield track.tick
    winner = yield from vote(stage, crew, track)
    if winner is not None:
        return winner
    return near if stage.fleet.alive[near] else None


def _send_belief(
    stage: RunContext, crew: Crew, track: Track, driver: Driver, flow: Any, successor: int, mission: Handover
) -> Waiting:
    belief = yield from driver.perform(flow)
    dissolve(stage, crew, track)
    if belief is None or not stage.fleet.alive[successor]:
        raise TrackLost("handover_lost")
    handed_on = replace(mission, belief=belief, at_once=mission.elected)
    handed_on.hops, handed_on.bits = mission.hops + driver.hops, mission.bits + driver.bits
    crew.appoint(track, successor, handed_on)


def _patience(stage: RunContext, track: Track, cluster: Cluster) -> set[int] | None:
    """Who senses now, if the cluster is too small: it stays until others do, or it would hand over at each step.

    Our choice, and an idealisation: the head knows of nodes that are not its members.
    """
    policy = stage.parts.clusters
    if policy.is_open or cluster.active() >= policy.minimum_active:
        return None
    return set(stage.sensing[track.target])
