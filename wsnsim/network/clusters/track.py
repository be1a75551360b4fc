"""One target's track: who leads, what was estimated, which clusters there were; and an election, where nobody leads.

What stands here outlives heads. A belief does not: it lives in its head's process, and dies with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.ports import ClusterPolicy, Estimate, Ranks, SensorModel
from wsnsim.base.rows import Issued
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.run_context import RunContext

if TYPE_CHECKING:
    from wsnsim.network.clusters.wake_up_service import WakeUpRound


@dataclass(slots=True)
class ClusterRecord:
    """One cluster's row."""

    number: int
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

    `head` is None where nobody leads; `tick` fires once a step, after the nodes have sensed. `prior` is what every
    filter is told at the start; `heads` has who led at the beginning of each step, -1 for nobody. `waking`: the last
    message that woke nodes ahead of the target; `wakings`: all of them.
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
    waking: WakeUpRound | None = None
    wakings: list[WakeUpRound] = field(default_factory=list)

    def wakings_for(self, step: int) -> Iterator[WakeUpRound]:
        """The messages that woke nodes for a step: several, where the target was lost and found again before it."""
        for waking in reversed(self.wakings):
            if waking.message.step < step:
                return
            if waking.message.step == step:
                yield waking


class Election:
    """Candidates broadcast their strength; when the last has, the loudest of those able is head.

    An idealisation: the winner is the loudest of all ballots, whoever heard which, and everybody knows it at once.

    `closed` fires with the winner, or None. `step` is when the strengths were read. `fills_vacancy`: nobody leads, so
    the winner takes the lead of itself.
    """

    def __init__(
        self,
        env: simpy.Environment,
        step: int,
        strengths: Mapping[int, float],
        policy: ClusterPolicy,
        fills_vacancy: bool,
        sensor: SensorModel,
    ) -> None:
        self.step = step
        self.strengths = strengths
        self.fills_vacancy = fills_vacancy
        self.closed = env.event()
        self._policy = policy
        self._sensor = sensor
        self._pending = set(strengths)
        self._ballots: dict[int, Mapping[int, Bools]] = {}

    def report(self, node: int, heard: Mapping[int, Bools]) -> None:
        """A candidate's broadcast is out, and reached those in `heard`. The dead are heard no more."""
        if node not in self._pending:
            return
        self._ballots[node] = heard
        self._withdraw(node)

    def withdraw(self, node: int) -> None:
        """A candidate died before, or after, its broadcast."""
        self._ballots.pop(node, None)
        self._withdraw(node)

    def _withdraw(self, node: int) -> None:
        self._pending.discard(node)
        if not self._pending and not self.closed.triggered:
            ids = sorted(self._ballots)
            strengths = [self._strength(self.strengths[i]) for i in ids]
            self.closed.succeed(self._policy.elect(ids, strengths, [True] * len(ids)) if ids else None)

    def _strength(self, reading: float) -> float:
        """How near a reading says the target is; most sensors read more where it is nearer."""
        return self._sensor.strength(reading) if isinstance(self._sensor, Ranks) else reading

    def readings_at(self, node: int) -> dict[int, float]:
        """{candidate: reading} that a candidate knows after the election."""
        return {i: self.strengths[i] for i, heard in sorted(self._ballots.items()) if i == node or node in heard}


def ballot_box(stage: RunContext, track: Track, fills_vacancy: bool) -> Election:
    """An election among the nodes that sense the track's target now and are able."""
    readings = stage.sensing[track.target]
    able = {node: reading for node, reading in readings.items() if stage.able(node)}
    return Election(stage.env, stage.step, able, stage.parts.clusters, fills_vacancy, stage.parts.sensor)
