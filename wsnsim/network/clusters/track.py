"""One target's track: its head, its estimates, its clusters and its wake-up rounds.

A track outlives its heads. A belief does not: the head's process holds it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import simpy

from wsnsim.base.ports import Estimate
from wsnsim.base.rows import Issued
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.election import Election
from wsnsim.network.clusters.handover import Handover


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
        tick: fires once per step, after the nodes have sensed.
        head: the cluster head, None where the track has none.
        heads: the head at the beginning of each step, -1 for none.
        started: the track has been initiated at least once.
        round: the last wake-up round; `rounds`: all of them.
    """

    target: int
    prior: Estimate
    tick: simpy.Event
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

    def rounds_for(self, step: int) -> Iterator[WakeUpRound]:
        """The rounds that woke nodes for a step: several, if the target was lost and found again before it."""
        for one in reversed(self.rounds):
            if one.message.step < step:
                return
            if one.message.step == step:
                yield one

    def open_cluster(self, cluster: Cluster, handover: Handover, now: float) -> None:
        """Make a cluster that has formed the track's own, and record it."""
        record = ClusterRecord(len(self.clusters), cluster.head, handover.previous_head, now, cluster.size)
        record.hops, record.handover_bits = handover.hops, handover.bits
        self.clusters.append(record)
        self.cluster = cluster
