"""Particles that are distributed over members: the head's belief, likelihoods at members, and local estimates.

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
from typing import ClassVar, Final, Generic, NamedTuple, TypeAlias, TypeVar, cast

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, Ints, missing
from wsnsim.base.optional_ports import MeasuresEnergy, defined_together
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Broadcast, Delivery, Flow, Local, Member, Parcel
from wsnsim.trackers.shared.dealing import (
    Deal,
    Pool,
    at_head,
    give,
    no_particles,
    predict_only,
    resampled,
    send_all,
    send_moments,
    update_deal,
)
from wsnsim.trackers.shared.moments import forecast, predicted
from wsnsim.trackers.shared.readings import (
    Evidence,
    evidence_at,
    is_whole,
    parcel,
    share_readings,
    state_packets,
)
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

Energies: TypeAlias = tuple[Floats, Floats, Floats, tuple[float, float, float, float, float]]
"""Readings (M,) of an energy, one a member, positions (M, 2) and gains (M,) of the sensors, and their law.

The law is that of `kernels.acoustic`."""


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
        return seen.readings, np.ascontiguousarray(seen.positions), gains, law

    def among(self, rows: Ints) -> OwnReadings:
        """The likelihood of some of the members."""
        return replace(self, evidence=self.evidence.part(rows))

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
    effective: float = math.nan
    shares: Shares = field(default_factory=Shares)


S = TypeVar("S", bound=Spread)


class SpreadFilter(Generic[S]):
    """The base of a particle filter whose particles are spread over the members of a cluster.

    A subclass has the fields below, and gives `belief`, `collect`, `work` and `after_work`.
    """

    angles: ClassVar[bool] = True
    vector_readings: ClassVar[bool] = True
    belief: ClassVar[type[Spread]] = Spread
    """The class of its beliefs."""

    particles: int
    measurements: str
    handover: str

    def start(self, prior: Estimate, scene: Scene) -> Flow[S]:
        """Draw the particles from the prior at the head and deal them out; paid like a handover's deal-out."""
        nothing, by_moments = at_head(no_particles(prior.mean.size)), self.handover == "gaussian"
        deal = yield from update_deal(nothing, prior.mean, prior.cov, self.particles, by_moments, scene)
        return self._begun(prior.mean, prior.cov, deal, scene.head)

    def step(self, belief: S, scene: Scene) -> Flow[S]:
        """One step: members work on their particles, and report; without an active one all is only predicted."""
        by_moments = self.handover == "gaussian"
        deal = yield from update_deal(belief.deal, belief.mean, belief.cov, self.particles, by_moments, scene)
        if not scene.ids:
            deal = yield from predict_only(deal, belief.shares, scene)
            return only_predicted(belief, deal, scene)
        if self.measurements == "all":
            yield from share_readings(scene)

        def work_all(members: list[Member]) -> None:
            self.work(members, belief.shares, scene)

        yield Local(lambda member: work_all([member]), _cycles_of, work_all)
        return (yield from self.after_work(belief, deal, scene))

    def hand_over(self, belief: S, scene: Scene, successor: int) -> Flow[S | None]:
        """Members to head n packets each; head to successor N_p + ceil(N_p / 4) + 4, or the 4 of the moments alone.

        The next head has everything then, and has not dealt it out.
        """
        if self.handover == "gaussian":
            arrival = yield from send_moments(belief.mean, belief.cov, successor)
        else:
            pool = belief.deal.whole if belief.deal.whole is not None else (yield from self.collect(belief))
            arrival = yield from send_all(pool or no_particles(belief.mean.size), belief.mean, belief.cov, successor)
        return None if arrival is None else self._begun(arrival.mean, arrival.cov, at_head(arrival.pool), successor)

    def forecast(self, belief: S, scene: Scene, ahead: int) -> Estimate:
        """The fused estimate `ahead` steps on."""
        return forecast(self.estimate(belief), scene, ahead)

    def estimate(self, belief: S) -> Estimate:
        """The fused estimate; the effective number is that of the particles before the step's resampling or move."""
        return Estimate(belief.mean, belief.cov, belief.effective)

    def snapshot(self, belief: S, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(node, particles (D, n), weights (n,)) of each holder, the weights normalised over the whole set."""
        whole = belief.deal.whole
        if whole is not None:
            return snapshot([(belief.head, whole.cloud, whole.log_weights)])
        return snapshot([(member.id, *present(member, belief.mean.size)) for member in members])

    def collect(self, belief: S) -> Flow[Pool | None]:
        """All particles that the members hold, in n packets each."""
        raise NotImplementedError

    def work(self, members: list[Member], shares: Shares, scene: Scene) -> None:
        """Predict and weigh the members' particles; a `LocalEstimate` stays in the memory of each."""
        raise NotImplementedError

    def after_work(self, belief: S, deal: Deal, scene: Scene) -> Flow[S]:
        """The belief after the members have reported."""
        raise NotImplementedError

    def _begun(self, mean: Floats, cov: Floats, deal: Deal, head: int) -> S:
        return cast(S, self.belief(mean, cov, cov, deal, head))


def give_all(member: Member) -> Parcel | None:
    """All of a member's particles, equally weighted, without weights."""
    member.inbox = settle(member)
    log_weights = member.memory.get(LOG_WEIGHTS, np.empty(0))
    if log_weights.size and np.any(log_weights != log_weights[0]):
        columns = resampled(log_weights, log_weights.size, member.key)
        keep(member, np.take(member.memory[CLOUD], columns, axis=1), np.zeros(log_weights.size))
    return give(member, log_weights.size, common=0.0)


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


def _cycles_of(member: Member) -> float:
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


def only_predicted(belief: S, deal: Deal, scene: Scene) -> S:
    """The belief when nothing arrived: the motion's prediction, its covariance grown."""
    mean, cov = predicted(belief.mean, belief.cov, scene)
    within = within_predicted(belief, scene)
    return replace(belief, mean=mean, cov=cov, within=within, deal=deal, head=scene.head, effective=math.nan)


def within_predicted(belief: Spread, scene: Scene) -> Floats:
    """(D, D) the last covariance of one cloud that the head knew, grown."""
    return predicted(belief.mean, belief.within, scene)[1]
