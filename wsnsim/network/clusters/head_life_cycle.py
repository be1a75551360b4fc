"""What every head's time in office has in common, whether its cluster stands or moves: how it ends, and what it says.

tenure(stage, crew, track, head, mission, life)      one SimPy process a head and target
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any

import simpy

from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.rows import Issued, wants_belief, write_belief
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver, HeadDied
from wsnsim.network.clusters.handover import Crew, Handover, TrackLost
from wsnsim.network.clusters.track import ClusterRecord, Track
from wsnsim.network.run_context import RunContext

Waiting = Generator[simpy.Event, Any, Any]
Life = Callable[[RunContext, Crew, Track, int, Handover], Waiting]


def tenure(stage: RunContext, crew: Crew, track: Track, head: int, mission: Handover, life: Life) -> Waiting:
    """A head's life for one target, from taking over until handing on."""
    try:
        if not mission.at_once:
            yield track.tick
        yield from life(stage, crew, track, head, mission)
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


def enter_office(stage: RunContext, track: Track, cluster: Cluster, mission: Handover) -> None:
    """Note a new cluster, and how its head came to lead it."""
    record = ClusterRecord(len(track.clusters), cluster.head, mission.previous_head, stage.env.now, cluster.size)
    record.hops, record.handover_bits = mission.hops, mission.bits
    track.clusters.append(record)
    track.cluster = cluster


def dissolve(stage: RunContext, crew: Crew, track: Track) -> None:
    """The cluster's members are free; what they remember of it is forgotten."""
    if track.cluster is not None:
        track.clusters[-1].released = stage.env.now
        crew.release(track, track.cluster)
        track.cluster = None


def _give_up(stage: RunContext, crew: Crew, track: Track, why: str) -> None:
    """The belief is gone: say so, and leave the track to the next election, or to whoever detects the target."""
    stage.log("lost", track.target, -1 if track.head is None else track.head, why)
    dissolve(stage, crew, track)
    track.head = None


def count_start(stage: RunContext, track: Track, head: int) -> None:
    """A track has started; if it was on before, it has been re-acquired."""
    if track.started:
        track.reacquired += 1
        stage.log("reacquire", track.target, head)
    elif stage.parts.clusters.moves:
        stage.log("acquire", track.target, head)
    track.started = True


def issue(stage: RunContext, track: Track, step: int, scene: Scene, driver: Driver, estimate: Estimate) -> None:
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


def snapshot(stage: RunContext, track: Track, cluster: Cluster, belief: Any, step: int) -> None:
    """Record the particles and the tracker's state, if their tables are wanted."""
    if not wants_belief(stage.recorder):
        return
    members = [cluster.members[node] for node in cluster.roster()]
    key = {"replicate": stage.replicate, "target": track.target, "step": step}
    columns = stage.parts.motions[track.target].columns
    write_belief(stage.recorder, key, stage.parts.tracker, belief, members, columns)
