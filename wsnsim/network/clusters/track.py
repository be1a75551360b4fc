"""One target's track: its head, its estimates, its clusters and wake-up rounds, and what one head hands to the next.

A track outlives its heads. A belief does not: the head's process holds it. Where readings name no target, a book holds
the numbers of tracks, their events, and the rows of `estimates`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Estimate, Reading
from wsnsim.base.ports import MotionModel
from wsnsim.base.rows import Issued, is_late
from wsnsim.base.scans import Facts, ScanOutcome, TrackEstimate
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.election import Election
from wsnsim.network.clusters.network_view import one_step_on
from wsnsim.network.event_log import ProtocolLog

EVENTS = {"start": "initiate", "confirm": "confirm", "delete": "delete", "merge": "delete"}
"""The kinds of events in the log, by what trackers say of tracks."""
MOST_GROUPS = 2**15
"""Numbers of groups that the column `target` of events holds."""
UNKNOWN = Estimate(np.empty(0), np.empty((0, 0)))
"""The prior of a group: there is none."""
SAME: Final = 3.0
"""Standard deviations of the difference of two states within which they are one target's (our choice)."""


@dataclass(frozen=True, slots=True)
class Handover:
    """What a new head, `successor`, starts from: a belief that reached it or, for a new track, readings that it knows.

    Attributes:
        belief_step: the step of the belief or of the readings.
        hops: number of hops of the belief to the successor.
        bits: bits sent on these hops.
        elected: a network-wide election has chosen the successor.
        acts_now: the successor acts in the present step, not at the next tick.
        detected: {node: reading} of a target without a track. This and the following are used by moving heads only.
        wakes_nodes: the successor has nodes woken before it does anything else.
        last_sensed: time in s at which the target was last sensed.
        belief_time: time in s of the belief; None: the instant of its step.
    """

    successor: int
    belief_step: int
    belief: Any = None
    readings: Mapping[int, Reading] | None = None
    previous_head: int = -1
    hops: int = 0
    bits: int = 0
    elected: bool = False
    acts_now: bool = False
    detected: Mapping[int, Reading] | None = None
    wakes_nodes: bool = False
    last_sensed: float = 0.0
    belief_time: float | None = None


class TrackLost(Exception):
    """The track was lost while its cluster head is alive. The argument is the reason that is logged."""


class NotDelivered(TrackLost):
    """Nothing of a belief arrived at the next head. A patient head goes on with it, others lose the track."""

    def __init__(self) -> None:
        super().__init__("handover_lost")


class GroupEnded(Exception):
    """A group has no tracks any more, or another head has them."""


class LastClusterDone(Exception):
    """The scenario ends with this cluster (`until.clusters`)."""


@dataclass(slots=True)
class ClusterRecord:
    """One cluster's row in the table `clusters`."""

    cluster: int
    head: int
    previous_head: int
    formed: float
    members: int = 1
    released: float = float("nan")
    hops: int = 0
    handover_bits: int = 0


@dataclass(slots=True)
class Track:
    """The track of one target.

    Attributes:
        prior: what every filter is given at the start.
        known_at_start: the target is present at step 0, where the prior tells where it is.
        tick: fires once per step, after the nodes have sensed.
        head: the cluster head, None where the track has none.
        heads: the head at the beginning of each step, -1 for none.
        started: the track has been initiated at least once.
        round: the last wake-up round; `rounds`: all of them.
    """

    target: int
    prior: Estimate
    tick: simpy.Event
    known_at_start: bool = True
    head: int | None = None
    cluster: Cluster | None = None
    election: Election | None = None
    started: bool = False
    reacquired: int = 0
    handovers: int = 0
    heads: list[int] = field(default_factory=list)
    estimates: dict[int, Issued] = field(default_factory=dict)
    clusters: list[ClusterRecord] = field(default_factory=list)
    round: WakeUpRound | None = None
    rounds: list[WakeUpRound] = field(default_factory=list)

    def open_cluster(self, cluster: Cluster, handover: Handover, now: float) -> None:
        """Make a cluster that has formed the track's own, and record it."""
        record = ClusterRecord(len(self.clusters), cluster.head, handover.previous_head, now, cluster.size)
        record.hops, record.handover_bits = handover.hops, handover.bits
        self.clusters.append(record)
        self.cluster = cluster


def outdone(track: TrackEstimate, others: Iterable[TrackEstimate]) -> bool:
    """Whether one of the others is of the same target and stays: one that is confirmed, of such the oldest number."""
    return any(
        (not each.confirmed, each.number) < (not track.confirmed, track.number) and _same(track, each)
        for each in others
    )


def _same(one: TrackEstimate, other: TrackEstimate) -> bool:
    """Whether all columns of two states are as near as those of one target that two heads track by themselves."""
    apart = one.mean - other.mean
    return float(apart @ np.linalg.solve(one.cov + other.cov, apart)) <= SAME**2


def predicted(track: TrackEstimate, facts: Facts, since: int, until: int) -> TrackEstimate:
    """A track of a step, predicted for a later one."""
    estimate = Estimate(track.mean, track.cov)
    for step in range(since, until):
        estimate = one_step_on(estimate, facts.motion, facts.dt, step * facts.dt)
    return track._replace(mean=estimate.mean, cov=estimate.cov)


class TrackRow(NamedTuple):
    """What a head held of a track at a step. `group`: the group of the track."""

    track: TrackEstimate
    issued: Issued
    group: int


@dataclass(slots=True)
class TrackBook:
    """The tracks of all groups.

    Attributes:
        write: Writes what the tables of a result have of a group that has ended: nothing is kept of it.
        priors: Of the targets that are present at step 0.
        next: The number of the next track: numbers are unique in a run (an idealisation: heads agree on them at once).
        groups: The groups that have a head or will have one.
        opened: How many have been opened; `clusters` and `handovers`: how many those had that have ended.
        rows: What heads held, in the order of time.
    """

    log: ProtocolLog
    env: simpy.Environment
    write: Callable[[Track], None]
    priors: Sequence[Estimate] = ()
    next: int = 0
    groups: list[Track] = field(default_factory=list)
    opened: int = 0
    clusters: int = 0
    handovers: int = 0
    rows: list[TrackRow] = field(default_factory=list)

    def open_group(self) -> Track:
        """A new group, which has no head yet. Numbers start again after `MOST_GROUPS`."""
        group = Track(self.opened % MOST_GROUPS, UNKNOWN, self.env.event())
        self.groups.append(group)
        self.opened += 1
        return group

    def close_groups(self) -> None:
        """Forget the groups that have neither a head nor an election; their rows are written."""
        for group in [group for group in self.groups if group.head is None and group.election is None]:
            self.groups.remove(group)
            self.clusters += len(group.clusters)
            self.handovers += group.handovers
            self.write(group)

    def note(self, group: int, head: int, outcome: ScanOutcome) -> None:
        """Log what happened to tracks, and count those that began."""
        for event in outcome.events:
            what = "duplicate" if event.kind == "merge" else ""
            self.log.add(EVENTS[event.kind], group, head, what, sequence=event.track)
            self.next = max(self.next, event.track + 1)

    def columns(self, motion: MotionModel, received: Mapping[tuple[int, int], float], dt: float) -> dict[str, Any]:
        """The columns of the table `estimates`, ordered by step and then by track."""
        rows = sorted(self.rows, key=lambda row: (row.issued.step, row.track.number))
        size, place = len(motion.columns), list(motion.position)
        means = np.array([row.track.mean for row in rows]).reshape(-1, size)
        covs = np.array([row.track.cov for row in rows]).reshape(-1, size, size)
        issued = [row.issued for row in rows]
        steps = np.array([each.step for each in issued], dtype=np.int64)
        of_issued = ("issued", "head", "active", "members", "readings")
        return {
            "track": np.array([row.track.number for row in rows], dtype=np.int64),
            "step": steps,
            "time": steps * dt,
            **{name: np.array([getattr(each, name) for each in issued]) for name in of_issued},
            **{name: means[:, i] for i, name in enumerate(motion.columns)},
            **{name: np.sqrt(covs[:, i, i]) for name, i in zip(("sd_x", "sd_y"), place, strict=False)},
            **({"cov_xy": covs[:, place[0], place[1]]} if len(place) > 1 else {}),
            "confirmed": np.array([row.track.confirmed for row in rows], dtype=np.uint8),
            "existence": np.array([row.track.existence for row in rows], dtype=np.float64),
            "received": np.array(
                [received.get((row.group, row.issued.step), np.nan) if row.track.confirmed else np.nan for row in rows]
            ),
            "late": np.array([is_late(each.issued, each.step, dt) for each in issued], dtype=np.uint8),
            "effective_particles": np.full(len(rows), np.nan),
        }
