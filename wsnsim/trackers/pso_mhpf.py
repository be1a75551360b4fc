"""A particle filter on the members of a cluster; a swarm move with a Metropolis-Hastings test replaces resampling.

Jiang, Song, Lin (2013), sections 3 and 4. Requests of a step:

    [re-deal]  [readings up, readings down]  Local: filter the own share  Gather: local estimates  [Broadcast: feedback]
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS, Flow, Gather, Local, Member, Parcel, all_arrived
from wsnsim.base.setups import NetworkSetup
from wsnsim.kernels.gaussian import fuse
from wsnsim.trackers.shared.dealing import (
    PREDICT_CYCLES,
    SMALLEST_CLUSTER,
    Deal,
    most_readings,
    predict_only,
    update_deal,
)
from wsnsim.trackers.shared.moments import forecast, fused_by_variance, noise_issues, symmetric
from wsnsim.trackers.shared.readings import share_readings, state_packets
from wsnsim.trackers.shared.spread import (
    LOCAL,
    LocalEstimate,
    Spread,
    begin,
    collected,
    cycles_of,
    feed_back,
    hand_on,
    likelihood_of,
    local_estimate,
    look,
    only_predicted,
    reported_variances,
    within_predicted,
)
from wsnsim.trackers.shared.stacks import LOG_WEIGHTS, Shares, propagated
from wsnsim.trackers.shared.swarms import Pull, Rules, filter_swarms

ALWAYS = 2.0
"""A threshold of effective particles that no share of them reaches."""


@part
class PsoMhpf:
    """PSO-MHPF: members predict, weigh and move their own particles, and send only their local estimates.

    The move is a heuristic and no valid Markov chain: the proposal depends on the whole swarm's past, the ratio of the
    proposals is taken as one, and the paper's posterior, a sum of Diracs, cannot be evaluated at a new point.
    `acceptance` says what stands in for it: the likelihood times a Gaussian fitted to the node's predicted particles
    (our choice), times the particle's own transition density, or alone, which loses the target.

    Weights of steps without a move are carried on. In the paper they enter w_k (13), thereby the posterior of (15) in
    the test (20), and χ_0 (17), which is w_k. So they do here: `prior_fit` weights the Gaussian by w_{k-1}, and
    `ranking` takes χ_0 = w_k, normalised over the node's own share, although χ of later iterations is a likelihood
    (23). `unweighted` and `likelihood` leave them out of both, as earlier versions did. After the move weights are
    equal and the last iterate alone is kept, so that a burn-in has no effect of its own. A chain starts at every
    particle, however small its weight, unless `resample_first`.

    Without random factors and with a step length of one, eq. (18) has a double root at -1 and swings up: literal. The
    particles' share of the head is our choice.
    """

    angles: ClassVar[bool] = True
    vector_readings: ClassVar[bool] = True

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: total number of particles"] = 400
    iterations: Annotated[int, Quantity("", ge=0), "moves of the swarm per step"] = 2
    phi1: Annotated[float, Quantity("", ge=0), "pull towards the particle's own best, eq. 18"] = 2.0
    phi2: Annotated[float, Quantity("", ge=0), "pull towards the node's best, eq. 18"] = 2.0
    random_factors: Annotated[bool, "whether uniform random factors scale the pulls"] = True
    step_length: Annotated[Literal["one", "dt"], "factor of the velocity, eq. 19: one, or the time step"] = "one"
    acceptance: Annotated[
        Literal["gaussian", "transition", "likelihood"],
        "what stands beside the likelihood in the acceptance ratio, eq. 20",
    ] = "gaussian"
    prior_fit: Annotated[
        Literal["weighted", "unweighted"],
        "whether the Gaussian of `acceptance` is fitted to the predicted particles with their weights w_{k-1}",
    ] = "weighted"
    ranking: Annotated[
        Literal["weight", "likelihood"],
        "χ_0, which ranks particles before the first move: the normalised weight w_k (eq. 17), or the likelihood alone",
    ] = "weight"
    measurements: Annotated[Literal["own", "all"], "readings that a member uses for its weights"] = "own"
    threshold: Annotated[
        float, Quantity("", ge=0, le=1), "the swarm moves below this fraction of effective particles"
    ] = 0.5
    resample_always: Annotated[bool, "whether the swarm moves at every step, as in Fig. 3"] = False
    resample_first: Annotated[bool, "whether systematic resampling precedes the move"] = False
    estimate_when: Annotated[
        Literal["after", "before"], "whether local estimates are taken after or before the move"
    ] = "after"
    fusion: Annotated[Literal["share", "inverse_variance"], "how the head weights local estimates"] = "share"
    feedback: Annotated[bool, "whether the head broadcasts the fused estimate and members shift their particles"] = (
        False
    )
    handover: Annotated[Literal["particles", "gaussian"], "what a handover carries"] = "particles"

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """The transition density needs a process noise that can be inverted."""
        if self.acceptance == "transition":
            yield from noise_issues(setup, "acceptance: transition")

    @property
    def member_cycles(self) -> float:
        """Operations of one member of the smallest cluster in a step with a move, its share being N_p / 3."""
        seen = most_readings(self.measurements)
        return self.particles / SMALLEST_CLUSTER * self._per_particle(seen, True, 1)

    def start(self, prior: Estimate, scene: Scene) -> Flow[Spread]:
        """Draw the particles from the prior at the head and deal them out; paid like a handover's deal-out."""
        return begin(prior, self.particles, self.handover == "gaussian", scene)

    def step(self, belief: Spread, scene: Scene) -> Flow[Spread]:
        """One step: N_act - 1 local estimates reach the head; without an active member everything is only predicted."""
        by_moments = self.handover == "gaussian"
        deal = yield from update_deal(belief.deal, belief.mean, belief.cov, self.particles, by_moments, scene)
        if not scene.ids:
            deal = yield from predict_only(deal, belief.shares, scene)
            return only_predicted(belief, deal, scene)
        if self.measurements == "all":
            yield from share_readings(scene)

        def work_all(members: list[Member]) -> None:
            self._filter(members, belief.shares, scene)

        yield Local(lambda member: work_all([member]), cycles_of, work_all)
        own: list[LocalEstimate] = []
        reply = yield Gather(self._reporter(scene.head, belief.mean.size, own))
        after = self._fused(belief, deal, scene, reply, own[0] if own else None)
        if self.feedback:
            yield from feed_back(after, scene)
        return after

    def hand_over(self, belief: Spread, scene: Scene, successor: int) -> Flow[Spread | None]:
        """Members to head n packets each; head to successor N_p + ceil(N_p / 4) + 4, or the 4 of the moments alone.

        The paper counts no packet for the members' weights: a member whose weights differ resamples its share first
        (our choice), with its own key.
        """
        collect = None if self.handover == "gaussian" else collected(belief)
        return hand_on(belief, collect, successor)

    def estimate(self, belief: Spread) -> Estimate:
        """The fused estimate; the effective number is that of the head's own share before its move."""
        return Estimate(belief.mean, belief.cov, belief.effective)

    def forecast(self, belief: Spread, scene: Scene, ahead: int) -> Estimate:
        """The fused estimate `ahead` steps on."""
        return forecast(self.estimate(belief), scene, ahead)

    def snapshot(self, belief: Spread, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(node, particles (D, n), weights (n,)) of each holder, the weights normalised over the whole set."""
        return look(belief, members)

    def _filter(self, members: list[Member], shares: Shares, scene: Scene) -> None:
        """Predict, weigh and move each member's particles (section 4, steps 5-8); the result stays in its memory."""
        stack, heard = shares.stacked(members, len(scene.motion.columns))
        likelihood = likelihood_of(self.measurements, members, heard, scene)
        before, stack.cloud = propagated(stack.cloud, stack.offsets, stack.keys, scene)  # eq. 12
        filtered = filter_swarms(stack, before, likelihood, self._rules(scene.dt), scene)
        shares.store(stack)
        cycles = self._cycles(stack.counts.tolist(), likelihood.sensors, filtered.moving.tolist(), scene.steps)
        results = map(
            local_estimate, zip(filtered.means, filtered.covs, cycles, filtered.effective.tolist(), strict=True)
        )
        for member, result in zip(members, results, strict=True):
            member.memory[LOCAL] = result

    def _rules(self, dt: float) -> Rules:
        """When and how the swarms move."""
        threshold = ALWAYS if self.resample_always else self.threshold
        length = dt if self.step_length == "dt" else 1.0
        pull = Pull(self.iterations, self.phi1, self.phi2, length, self.random_factors)
        options = self.acceptance, self.prior_fit, self.ranking, self.resample_first, self.estimate_when
        return Rules(threshold, pull, *options)

    def _cycles(self, counts: list[int], sensors: list[int], moving: list[bool], steps: int) -> list[float]:
        """What each member spends on its particles, section 5."""
        work = list(zip(sensors, moving, strict=True))
        each = {seen_moves: self._per_particle(*seen_moves, steps) for seen_moves in set(work)}
        return [count * each[seen_moves] for count, seen_moves in zip(counts, work, strict=True)]

    def _per_particle(self, seen: int, moves: bool, steps: int) -> float:
        """Section 5: predict and weigh 40 + 30 S, and to move, Gaussian fit 30 and 50 + 30 S an iteration."""
        fit_cycles = 30.0 if self.acceptance == "gaussian" else 0.0
        move_cycles = fit_cycles + self.iterations * (50.0 + 30.0 * seen) if moves else 0.0
        return PREDICT_CYCLES * steps + 30.0 * seen + move_cycles

    def _reporter(self, head: int, columns: int, own: list[LocalEstimate]) -> Callable[[Member], Parcel | None]:
        """A function that gives a member's report: one packet, and one more for variances if the head uses them.

        The payload is the mean, followed by the variances. The head's own estimate is put into `own`.
        """
        with_variances = self.fusion == "inverse_variance"
        packets = state_packets(columns) * (2 if with_variances else 1)

        def report(member: Member) -> Parcel | None:
            result: LocalEstimate | None = member.memory.get(LOCAL)
            if result is None or not member.memory[LOG_WEIGHTS].size:
                return None
            if member.id == head:
                own.append(result)
            payload = np.concatenate([result.mean, np.diag(result.cov)]) if with_variances else result.mean
            return Parcel(payload, packets, PACKET_BITS, "estimate", 0)

        return report

    def _fused(
        self, belief: Spread, deal: Deal, scene: Scene, reply: dict[int, tuple[Floats, Bools]],
        own: LocalEstimate | None,
    ) -> Spread:  # fmt: skip
        """Local estimates by their share of the particles, the shares renormalised over those that arrived.

        A report of particles that the head does not know of is left out. The covariance is the spread of the local
        means plus that of one cloud: the head's own, or where it has none, the last it had, predicted.
        """
        columns, held, shares, rows, masks = belief.mean.size, deal.held, [], [], []
        packets = state_packets(columns)
        whole = all_arrived(packets)
        for node, (row, mask) in reply.items():
            if held.get(node) and (mask is whole or mask[:packets].all()):
                shares.append(held[node])
                rows.append(row)
                masks.append(mask)
        if not rows:
            return only_predicted(belief, deal, scene)
        reports = np.concatenate(rows).reshape(len(rows), -1)
        means = reports[:, :columns]
        if self.fusion == "inverse_variance":
            variances = reported_variances(reports[:, columns:], masks, packets)
            if variances is not None:
                mean, spread, within = fused_by_variance(means, variances)
                return Spread(mean, symmetric(spread + within), within, deal, scene.head, shares=belief.shares)
        within = within_predicted(belief, scene) if own is None else own.cov
        mean, cov = fuse(np.ascontiguousarray(means), np.array(shares, dtype=np.float64), within)
        return Spread(mean, cov, within, deal, scene.head, own.effective if own else math.nan, belief.shares)
