"""One target's track: its head, its estimates, its clusters and wake-up rounds, and what one head hands to the next.

A track outlives its heads. A belief does not: the head's process holds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import simpy

from wsnsim.base.arrays import Estimate, Reading
from wsnsim.base.rows import Issued
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.election import Election


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
