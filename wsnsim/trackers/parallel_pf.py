"""A bootstrap particle filter whose particles are distributed over the members; the head resamples the whole set.

The baseline PPF of Jiang, Song, Lin (2013). Requests of a step:

    [re-deal]  readings up, readings down  Local: predict and weigh  Gather: weights and local means
    when too few particles are effective:  Scatter: counts  Local: replicate  surplus particles up and down
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow, Gather, Local, Member, Parcel, Scatter
from wsnsim.kernels.gaussian import fuse
from wsnsim.kernels.particles import moments, weigh
from wsnsim.trackers.shared.dealing import (
    PREDICT_CYCLES,
    SMALLEST_CLUSTER,
    Deal,
    Pool,
    give,
    most_readings,
    pooled,
    redeal,
    resampled,
)
from wsnsim.trackers.shared.readings import (
    UNKNOWN,
    arrived_groups,
    arrived_particles,
    count_packets,
    guessed,
    is_whole,
    log_mean,
    number_packets,
    parcel,
    state_packets,
)
from wsnsim.trackers.shared.spread import (
    LOCAL,
    LocalEstimate,
    Spread,
    SpreadFilter,
    likelihood_of,
    only_predicted,
    within_predicted,
)
from wsnsim.trackers.shared.stacks import (
    CLOUD,
    LOG_WEIGHTS,
    Shares,
    keep,
    propagated,
    settle,
)

COUNTS = "counts"


@dataclass(frozen=True, slots=True)
class ParallelBelief(Spread):
    """A spread belief with the log-weights (n,) of each member's particles, as they last arrived at the head."""

    weights: Mapping[int, Floats] = field(default_factory=dict)


class WeightReport(NamedTuple):
    """Payload of a member's report: log-weights (n,) and local mean; with a covariance if it is the head's own."""

    log_weights: Floats
    mean: Floats
    cov: Floats | None


@part
class ParallelPf(SpreadFilter[ParallelBelief]):
    """PPF: members predict and weigh their share and send weights; the head returns how often each particle survives.

    Weights are kept on one scale over the whole set, so that a member that misses the counts keeps particles that are
    weighed rightly. Resampling restores the full number of particles after a loss.
    """

    belief: ClassVar[type[Spread]] = ParallelBelief

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: total number of particles"] = 400
    measurements: Annotated[Literal["all", "own"], "readings that a member uses for its weights"] = "all"
    threshold: Annotated[float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles"] = 0.5
    handover: Annotated[Literal["particles", "gaussian"], "what a handover carries"] = "particles"

    @property
    def member_cycles(self) -> float:
        """Operations of one member of the smallest cluster in a step, its share being N_p / 3: 40 + 30 S a particle."""
        return self.particles / SMALLEST_CLUSTER * (PREDICT_CYCLES + 30.0 * most_readings(self.measurements))

    def collect(self, belief: ParallelBelief) -> Flow[Pool | None]:
        """All particles that the members hold. The weights need no packets: they came up with the last step."""
        reply = yield Gather(lambda member: give(member, self.particles, common=0.0), tuple(belief.deal.held))
        return _weighed(reply, belief.weights)

    def work(self, members: list[Member], shares: Shares, scene: Scene) -> None:
        """Predict and weigh each member's particles, 40 + 30 S operations each, S the readings that it has."""
        stack, heard = shares.stacked(members, len(scene.motion.columns))
        likelihood = likelihood_of(self.measurements, members, heard, scene)
        _, stack.cloud = propagated(stack.cloud, stack.offsets, stack.keys, scene)
        fitness = likelihood.score(stack)(stack.cloud)
        stack.log_weights = stack.log_weights + np.where(np.isnan(fitness), -np.inf, fitness)
        means, covs = moments(stack.cloud, stack.log_weights, stack.offsets)
        shares.store(stack)
        cycles = stack.counts * (PREDICT_CYCLES * scene.steps + 30.0 * np.array(likelihood.sensors))
        for member, mean, cov, taken in zip(members, means, covs, cycles.tolist(), strict=True):
            member.memory[LOCAL] = LocalEstimate(mean, cov, taken)

    def after_work(self, belief: ParallelBelief, deal: Deal, scene: Scene) -> Flow[ParallelBelief]:
        """Gather weights and local means; where too few particles of the whole set are effective, resample it."""
        reply = yield Gather(lambda member: _report(member, scene.head))
        after = self._fused(belief, deal, scene, reply)
        if after.effective < self.threshold * sum(weights.size for weights in after.weights.values()):
            after = yield from self._resample(after, scene)
        return after

    def _fused(
        self,
        belief: ParallelBelief,
        deal: Deal,
        scene: Scene,
        reply: dict[int, tuple[WeightReport, Bools]],
    ) -> ParallelBelief:
        """Local means by the sums of their weights; the covariance is their spread and that of one cloud.

        That is the head's own, or where it has none, the last it had, predicted.
        """
        weights, arrived = _tallied(reply, deal)
        log_weights = np.concatenate([np.empty(0), *weights.values()])
        effective = float(weigh(log_weights, np.array([0, log_weights.size]))[0])
        top = max((weights[node].max() for node in arrived), default=-np.inf)
        if not np.isfinite(top):
            return replace(only_predicted(belief, deal, scene), effective=effective, weights=weights)
        sums = np.array([np.exp(weights[node] - top).sum() for node in arrived])
        within = reply[scene.head][0].cov if scene.head in reply else None
        if within is None:
            within = within_predicted(belief, scene)
        mean, cov = fuse(np.array(list(arrived.values())), sums, within)
        return ParallelBelief(mean, cov, within, deal, scene.head, effective, belief.shares, weights)

    def _resample(self, belief: ParallelBelief, scene: Scene) -> Flow[ParallelBelief]:
        """Tell each holder how often its particles survive, ceil(n / 8) packets, and even out the numbers.

        The common log-weight afterwards rides in the header of the first packet (our choice). As many are drawn as the
        filter should have: what was lost is made good.
        """
        log_weights = np.concatenate(list(belief.weights.values()))
        level = log_mean(log_weights)
        drawn = np.bincount(resampled(log_weights, self.particles, scene.key), minlength=log_weights.size)
        cuts = np.cumsum([weights.size for weights in belief.weights.values()])[:-1]
        counts = dict(zip(belief.weights, np.split(drawn, cuts), strict=True))
        heard = yield Scatter(
            {node: parcel((copies, level), count_packets(copies.size), COUNTS) for node, copies in counts.items()}
        )
        yield Local(replicate, 0.0, None, tuple(heard))
        held = {node: copies.size for node, copies in counts.items()}
        held |= {node: int(_copies(counts[node], mask).sum()) for node, mask in heard.items()}
        deal = yield from redeal(replace(belief.deal, held=held), scene, common=level)
        return replace(belief, deal=deal, weights={})


def _report(member: Member, head: int) -> Parcel | None:
    """Weights, four to a packet, and the local mean."""
    log_weights = member.memory.get(LOG_WEIGHTS)
    if log_weights is None or not log_weights.size:
        return None
    result: LocalEstimate = member.memory[LOCAL]
    packets = number_packets(log_weights.size) + state_packets(result.mean.size)
    return parcel(
        WeightReport(log_weights.copy(), result.mean, result.cov if member.id == head else None), packets, "weights"
    )


def _tallied(reply: dict[int, tuple[WeightReport, Bools]], deal: Deal) -> tuple[dict[int, Floats], dict[int, Floats]]:
    """(log-weights (n,) of each holder, local means (D,)) that arrived; a lost weight is the mean of all others.

    A holder unheard of counts as it was.
    """
    weights = {node: np.full(count, UNKNOWN) for node, count in deal.held.items() if count}
    means = {}
    for node, (report, mask) in reply.items():
        size = report.log_weights.size
        if is_whole(mask):
            weights[node], means[node] = report.log_weights, report.mean
            continue
        known = np.repeat(mask[: number_packets(size)], 4)[:size]
        weights[node] = np.where(known, report.log_weights, UNKNOWN)
        if mask[number_packets(size) :].all():
            means[node] = report.mean
    everything = guessed(np.concatenate([np.empty(0), *weights.values()]))
    cuts = np.cumsum([piece.size for piece in weights.values()])[:-1]
    return dict(zip(weights, np.split(everything, cuts), strict=True)) if weights else {}, means


def _copies(counts: Ints, mask: Bools) -> Ints:
    """How often each particle survives on its node: as often as the counts say, once if their packet was lost."""
    if is_whole(mask):
        return counts
    return np.where(np.repeat(mask, 8)[: counts.size], counts, 1)


def replicate(member: Member) -> None:
    """Keep each particle as often as the head says, all with the same weight.

    A head that did not hear a member's weights takes it to hold what was dealt to it. If it holds another number of
    particles, the counts are not of these, and it keeps them as they are.
    """
    for news in settle(member):
        if news.what == COUNTS and news.payload[0].size == member.memory[CLOUD].shape[1]:
            counts, level = news.payload
            copies = _copies(counts, news.mask)
            keep(member, np.repeat(member.memory[CLOUD], copies, axis=1), np.full(int(copies.sum()), level))


def _weighed(reply: dict[int, tuple[tuple[Floats, float], Bools]], weights: Mapping[int, Floats]) -> Pool | None:
    """The particles that arrived, with the weights that the head has of them."""
    pieces = []
    for node, (sent, mask) in reply.items():
        cloud, equal = arrived_particles(sent, mask)
        if node in weights and weights[node].size == sent[0].shape[1]:
            arrived = arrived_groups(mask, weights[node].size, state_packets(cloud.shape[0]))
            pieces.append((cloud, weights[node][arrived]))
        else:
            pieces.append((cloud, np.full_like(equal, UNKNOWN)))
    return pooled(pieces)
