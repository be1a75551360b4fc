"""Particles that are distributed over members: the head's belief, likelihoods at members, and local estimates.

begin(prior, ...) -> Flow[Spread]     only_predicted(belief, deal, scene) -> belief     look(belief, members)

likelihood = likelihood_of("own", members, heard, scene)
log_likelihoods = likelihood.score(stack)(cloud)
likelihood.among(moving.rows).score(stack.part(moving))      the same for some of the members
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, Ints, missing
from wsnsim.base.optional_ports import MeasuresEnergy, defined_together
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Broadcast, Delivery, Flow, Gather, Local, Member, Parcel
from wsnsim.trackers.shared.dealing import (
    Deal,
    Pool,
    at_head,
    give,
    no_particles,
    pooled,
    resampled,
    send_all,
    send_moments,
    update_deal,
)
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.readings import Evidence, arrived_particles, evidence_at, is_whole, parcel, state_packets
from wsnsim.trackers.shared.stacks import (
    CLOUD,
    LOG_WEIGHTS,
    Score,
    Shares,
    Stack,
    keep,
    place_of,
    present,
    settle,
    snapshot,
)


class Energies(NamedTuple):
    """Readings (M,) of an energy, one a member, with the positions (M, 2) and gains (M,) of the sensors and their law.

    The law is that of `kernels.sensing`.
    """

    readings: Floats
    positions: Floats
    gains: Floats
    law: tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class OwnReadings:
    """Likelihood of stacked particles if each node uses only its own measurement."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: Evidence

    @classmethod
    def of(cls, members: Sequence[Member], scene: Scene) -> OwnReadings:
        """From the members' own readings; a missing one is not a number, and so is every likelihood with it."""
        none = missing(scene.sensor)
        values = np.array([none if member.reading is None else member.reading for member in members])
        ids = tuple([member.id for member in members])
        if ids == scene.ids:
            return cls(scene.sensor, place_of(scene), Evidence(ids, values, scene.positions, scene.traits))
        positions = np.concatenate([member.position for member in members]).reshape(len(members), -1)
        traits = np.concatenate([member.traits for member in members]).reshape(len(members), -1)
        return cls(scene.sensor, place_of(scene), Evidence(ids, values, positions, traits))

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [1] * len(self.evidence.ids)

    def energies(self) -> Energies | None:
        """What a kernel needs that weighs by the law of an energy; None if the sensor has a likelihood of its own."""
        if not defined_together(type(self.sensor), "energy_law", "log_likelihood"):
            return None
        seen = self.evidence
        law, gains = cast(MeasuresEnergy, self.sensor).energy_law(seen.traits)
        return Energies(seen.readings, np.ascontiguousarray(seen.positions), gains, law)

    def among(self, rows: Ints) -> OwnReadings:
        """The likelihood of some of the members."""
        seen = self.evidence
        ids = tuple([seen.ids[row] for row in rows.tolist()])
        return replace(self, evidence=Evidence(ids, seen.readings[rows], seen.positions[rows], seen.traits[rows]))

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's."""
        sensor, place, seen, owners = self.sensor, self.place, self.evidence, stack.layout.owners
        readings, positions, traits = seen.readings, seen.positions, seen.traits
        return lambda cloud: sensor.log_likelihood(cloud[place], readings, positions, traits, owners)


@dataclass(frozen=True, slots=True)
class SharedReadings:
    """Likelihood of stacked particles if each node uses the measurements of several nodes."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: list[Evidence]

    @classmethod
    def of(cls, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene) -> SharedReadings:
        """From what the members heard of the broadcast, and their own readings."""
        evidence = [evidence_at(member, news) for member, news in zip(members, heard, strict=True)]
        return cls(scene.sensor, place_of(scene), evidence)

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [len(seen.ids) for seen in self.evidence]

    def energies(self) -> Energies | None:
        """None: such a likelihood has no kernel for all members."""
        return None

    def among(self, rows: Ints) -> SharedReadings:
        """The likelihood of some of the members."""
        return replace(self, evidence=[self.evidence[row] for row in rows.tolist()])

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's; one call where all members have the same readings."""
        first = self.evidence[0]
        if all(seen is first for seen in self.evidence):
            return lambda cloud: self._of(cloud[self.place], first)
        cuts = stack.offsets.tolist()
        return lambda cloud: self._piecewise(cloud[self.place], cuts)

    def _piecewise(self, points: Floats, cuts: list[int]) -> Floats:
        segments = zip(self.evidence, pairwise(cuts), strict=True)
        return np.concatenate(
            [self._of(np.ascontiguousarray(points[:, first:last]), seen) for seen, (first, last) in segments]
        )

    def _of(self, points: Floats, seen: Evidence) -> Floats:
        return self.sensor.log_likelihood(points, seen.readings, seen.positions, seen.traits)


Likelihood: TypeAlias = OwnReadings | SharedReadings


def likelihood_of(
    measurements: str, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene
) -> Likelihood:
    """The likelihood that members use: of their 'own' measurements, or of 'all' that they received."""
    if measurements == "own":
        return OwnReadings.of(members, scene)
    return SharedReadings.of(members, heard, scene)


NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Spread:
    """Fused mean (D,) and covariance (D, D), of which `within` is one cloud's part; who holds how many particles.

    `shares` are no knowledge of the head: the simulation need not copy the members' particles end to end at each step.
    """

    mean: Floats
    cov: Floats
    within: Floats
    deal: Deal
    head: int
    effective: float = NAN
    shares: Shares = field(default_factory=Shares)


S = TypeVar("S", bound=Spread)


def begin(prior: Estimate, particles: int, by_moments: bool, scene: Scene) -> Flow[Spread]:
    """Draw the particles from the prior at the head and deal them out; paid like a handover's deal-out."""
    nothing = at_head(no_particles(prior.mean.size))
    deal = yield from update_deal(nothing, prior.mean, prior.cov, particles, by_moments, scene)
    return Spread(prior.mean, prior.cov, prior.cov, deal, scene.head)


def hand_on(belief: Spread, collect: Flow[Pool | None] | None, successor: int) -> Flow[Spread | None]:
    """Collect the particles and send them on, N_p + ceil(N_p / 4) + 4 packets; or the moments' 4 alone.

    `collect` brings in what the members hold, and is not asked where nothing was dealt out; None: the moments alone go.
    What is returned is all with the successor, and not yet dealt out; None if nothing reached it.
    """
    if collect is None:
        arrival = yield from send_moments(belief.mean, belief.cov, successor)
    else:
        pool = belief.deal.whole if belief.deal.whole is not None else (yield from collect)
        arrival = yield from send_all(pool or no_particles(belief.mean.size), belief.mean, belief.cov, successor)
    if arrival is None:
        return None
    return Spread(arrival.mean, arrival.cov, arrival.cov, at_head(arrival.pool), successor)


def collected(belief: Spread) -> Flow[Pool | None]:
    """Collect all particles that the members hold, in n packets each."""
    reply = yield Gather(_give_all, tuple(belief.deal.held))
    return pooled([arrived_particles(payload, mask) for payload, mask in reply.values()])


def _give_all(member: Member) -> Parcel | None:
    """All of a member's particles, equally weighted, without weights."""
    member.inbox = settle(member)
    log_weights = member.memory.get(LOG_WEIGHTS, np.empty(0))
    if log_weights.size and np.any(log_weights != log_weights[0]):
        columns = resampled(log_weights, log_weights.size, member.key)
        keep(member, np.take(member.memory[CLOUD], columns, axis=1), np.zeros(log_weights.size))
    return give(member, log_weights.size, common=0.0)


def only_predicted(belief: S, deal: Deal, scene: Scene) -> S:
    """The belief when nothing arrived: the motion's prediction, its covariance grown."""
    mean, cov = predicted(belief.mean, belief.cov, scene)
    within = within_predicted(belief, scene)
    return replace(belief, mean=mean, cov=cov, within=within, deal=deal, head=scene.head, effective=NAN)


def within_predicted(belief: Spread, scene: Scene) -> Floats:
    """(D, D) the last covariance of one cloud that the head knew, grown."""
    return predicted(belief.mean, belief.within, scene)[1]


def look(belief: Spread, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
    """(node, particles (D, n), weights (n,)) of each holder, the weights normalised over the whole set."""
    whole = belief.deal.whole
    if whole is not None:
        return snapshot([(belief.head, whole.cloud, whole.log_weights)])
    return snapshot([(member.id, *present(member, belief.mean.size)) for member in members])


LOCAL: Final = "local"
"""Key of the local estimate in a member's memory."""


class LocalEstimate(NamedTuple):
    """A member's own mean (D,) and covariance (D, D), their operations, and its effective number of particles."""

    mean: Floats
    cov: Floats
    cycles: float
    effective: float = math.nan


local_estimate = partial(tuple.__new__, LocalEstimate)
"""Makes a `LocalEstimate` of its four values; faster than the class, which matters for one a member and step."""


def cycles_of(member: Member) -> float:
    """The operations that the member's local estimate took."""
    estimate: LocalEstimate = member.memory[LOCAL]
    return estimate.cycles


def reported_variances(variances: Floats, masks: Sequence[Bools], packets: int) -> Floats | None:
    """The variances sent (M, D), a lost one taken to be the mean of the others'; None where all are lost.

    The masks are those of reports whose first `packets` packets hold something else.
    """
    known = np.array([is_whole(mask[packets:]) for mask in masks])
    if not known.any():
        return None
    variances = variances.copy()
    variances[~known] = variances[known].mean(axis=0)
    return variances


def feed_back(belief: Spread, scene: Scene) -> Flow[None]:
    """Broadcast the fused estimate: each member that receives it shifts its particles by the error of its own mean."""
    yield Broadcast(parcel(belief.mean, state_packets(belief.mean.size), "feedback"))

    def shift(member: Member) -> None:
        heard = [news.payload for news in settle(member) if news.what == "feedback" and news.mask.all()]
        target = belief.mean if member.id == scene.head else heard[-1] if heard else None
        if target is not None and LOCAL in member.memory and CLOUD in member.memory:
            offset = target - member.memory[LOCAL].mean
            keep(member, member.memory[CLOUD] + offset[:, None], member.memory[LOG_WEIGHTS])

    yield Local(shift, lambda member: float(member.memory[CLOUD].size if CLOUD in member.memory else 0))
