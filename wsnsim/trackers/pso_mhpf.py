"""A particle filter on the members of a cluster; a swarm move with a Metropolis-Hastings test replaces resampling.

Jiang, Song, Lin (2013), sections 3 and 4. Requests of a step:

    [re-deal]  [readings up, readings down]  Local: filter the own share  Gather: local estimates  [Broadcast: feedback]
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS, Flow, Gather, Member, Parcel, all_arrived
from wsnsim.base.rng import uniforms
from wsnsim.base.setups import NetworkSetup
from wsnsim.kernels.elementary import particle_keys
from wsnsim.kernels.gaussian import fit, fit_weighted, fuse, log_density
from wsnsim.kernels.particles import moments, systematic, weigh
from wsnsim.kernels.swarm import accept, fly, move_own
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES, SMALLEST_CLUSTER, Deal, Pool, most_readings, pooled
from wsnsim.trackers.shared.moments import fused_by_variance, noise_issues, symmetric
from wsnsim.trackers.shared.readings import arrived_particles, state_packets
from wsnsim.trackers.shared.spread import (
    LOCAL,
    Likelihood,
    LocalEstimate,
    Spread,
    SpreadFilter,
    feed_back,
    give_all,
    likelihood_of,
    local_estimate,
    only_predicted,
    reported_variances,
    within_predicted,
)
from wsnsim.trackers.shared.stacks import LOG_WEIGHTS, MOVE, START, Score, Shares, Stack, propagated

RIDGE = 1e-3
"""m², (m/s)²: added to the diagonal of a fitted covariance, which fewer than five particles leave singular."""
ALWAYS = 2.0
"""A threshold above every share of effective particles: the swarm moves at every step."""


class Predicted(NamedTuple):
    """The particles of a step between weighing and move.

    Attributes:
        before: (D, N) the particles one step ago.
        carried: (N,) their log-weights of the step before, w_{k-1}.
        fitness: (N,) log-likelihoods of the predicted particles.
    """

    before: Floats
    carried: Floats
    fitness: Floats


@part
class PsoMhpf(SpreadFilter[Spread]):
    """PSO-MHPF: members predict, weigh and move their own particles, and send only their local estimates.

    The move is a heuristic and no valid Markov chain: the proposal depends on the whole swarm's past, the ratio of the
    proposals is taken as one, and the paper's posterior, a sum of Diracs, cannot be evaluated at a new point.
    `acceptance` says what replaces it: the likelihood times a Gaussian fitted to the node's predicted particles (our
    choice), the likelihood times the particle's own transition density, or the likelihood alone, which loses the
    target.

    Weights of steps without a move are carried on. In the paper they enter w_k (13), thereby the posterior of (15) in
    the test (20), and χ_0 (17), which is w_k. So they do here: `prior_fit` weights the Gaussian by w_{k-1}, and
    `ranking` takes χ_0 = w_k, normalised over the node's own share, although χ of later iterations is a likelihood
    (23). `unweighted` and `likelihood` leave them out of both, as earlier versions did. After the move weights are
    equal and the last iterate alone is kept, so that a burn-in has no effect of its own. A chain starts at every
    particle, however small its weight, unless `resample_first`.

    Taken literally, without random factors and with a step length of one, eq. (18) has a double root at -1: it
    oscillates with growing amplitude. The share of the particles that the head holds is our choice.
    """

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

    def collect(self, belief: Spread) -> Flow[Pool | None]:
        """All particles that the members hold, in n packets each.

        The paper counts no packet for the members' weights: a member whose weights differ resamples its share first
        (our choice), with its own key.
        """
        reply = yield Gather(give_all, tuple(belief.deal.held))
        return pooled([arrived_particles(payload, mask) for payload, mask in reply.values()])

    def work(self, members: list[Member], shares: Shares, scene: Scene) -> None:
        """Predict, weigh and move each member's particles (section 4, steps 5-8); the result stays in its memory."""
        stack, heard = shares.stacked(members, len(scene.motion.columns))
        likelihood = likelihood_of(self.measurements, members, heard, scene)
        before, stack.cloud = propagated(stack.cloud, stack.offsets, stack.keys, scene)  # eq. 12
        means, covs, effective, moving = self._filtered(stack, before, likelihood, scene)
        shares.store(stack)
        cycles = self._cycles(stack.counts.tolist(), likelihood.sensors, moving.tolist(), scene.steps)
        results = map(local_estimate, zip(means, covs, cycles, effective.tolist(), strict=True))
        for member, result in zip(members, results, strict=True):
            member.memory[LOCAL] = result

    def after_work(self, belief: Spread, deal: Deal, scene: Scene) -> Flow[Spread]:
        """N_act - 1 local estimates reach the head, which fuses them."""
        own: list[LocalEstimate] = []
        reply = yield Gather(self._reporter(scene.head, belief.mean.size, own))
        after = self._fused(belief, deal, scene, reply, own[0] if own else None)
        if self.feedback:
            yield from feed_back(after, scene)
        return after

    def _filtered(
        self, stack: Stack, before: Floats, likelihood: Likelihood, scene: Scene
    ) -> tuple[Floats, Floats, Floats, Bools]:
        """Weigh a stack of predicted particles in place, and move the swarms of those who have few effective ones.

        Eqs. (13)-(24). `before` (D, N) are the particles one step ago. Returns the members' own estimates (M, D), their
        covariances (M, D, D), the effective numbers of particles (M,) before the move, and whose swarms moved (M,).
        """
        carried, fitness = stack.log_weights, likelihood.score(stack)(stack.cloud)
        stack.log_weights = carried + fitness  # eq. 13
        effective = weigh(stack.log_weights, stack.offsets)  # eq. 14
        moving = effective < (ALWAYS if self.resample_always else self.threshold) * stack.counts
        if self.estimate_when == "before":
            means, covs = moments(stack.cloud, stack.log_weights, stack.offsets)
        if any(moving.tolist()):
            self._move(stack, Predicted(before, carried, fitness), moving, likelihood, scene)
        if self.estimate_when == "after":
            means, covs = moments(stack.cloud, stack.log_weights, stack.offsets)  # eq. 16
        return means, covs, effective, moving

    def _move(self, stack: Stack, predicted: Predicted, moving: Bools, likelihood: Likelihood, scene: Scene) -> None:
        """Move the swarms of those who are `moving` (M,) in place of a resampling, and give them equal weights.

        Section 3, step 4. One kernel call moves all swarms if there is a kernel for these options.
        """
        length = scene.dt if self.step_length == "dt" else 1.0
        pull = self.phi1, self.phi2, length, self.random_factors
        has_kernel = self.acceptance == "gaussian" and self.prior_fit == "weighted" and not self.resample_first
        energies = likelihood.energies() if has_kernel and len(scene.motion.position) == 2 else None
        if energies is None:
            self._move_in_turn(stack, predicted, moving, likelihood, pull, scene)
            return
        x, y = scene.motion.position
        move_own(
            stack.cloud, stack.log_weights, predicted.carried, predicted.fitness, stack.offsets, moving,
            stack.layout.log_counts, stack.keys, *energies, (x, y), MOVE, (self.iterations, *pull),
            self.ranking == "weight", RIDGE,
        )  # fmt: skip

    def _move_in_turn(
        self, stack: Stack, predicted: Predicted, moving: Bools, likelihood: Likelihood,
        pull: tuple[float, float, float, bool], scene: Scene,
    ) -> None:  # fmt: skip
        """Do what `_move` does for any likelihood and any option, with one kernel call per operation."""
        chosen = stack.chosen(moving)
        swarms = stack.part(chosen)
        before, carried = predicted.before.take(chosen.columns, axis=1), predicted.carried.take(chosen.columns)
        fitness = predicted.fitness.take(chosen.columns)
        fitted = self._fitted(swarms, carried) if self.acceptance == "gaussian" else None
        ranks = fitness.copy()
        if self.ranking == "weight":  # log w of eq. (17), which sum to one; those of `weigh` have a mean of one
            ranks = swarms.log_weights - swarms.layout.log_counts[swarms.layout.owners]
        if self.resample_first:
            drawn = systematic(swarms.log_weights, swarms.offsets, swarms.counts, uniforms(swarms.keys, START))
            before, swarms.cloud = before.take(drawn, axis=1), swarms.cloud.take(drawn, axis=1)
            fitness, ranks = fitness.take(drawn), ranks.take(drawn)

        def log_prior(points: Floats) -> Floats:
            """(N,) log π of eq. (20), up to a constant per particle."""
            if fitted is not None:
                return log_density(points, *fitted, swarms.offsets)
            if self.acceptance == "transition":
                return scene.motion.log_transition(points, before, scene.dt, scene.previous)
            return np.zeros(points.shape[1])

        self._fly(swarms, fitness, ranks, likelihood.among(chosen.rows).score(swarms), log_prior, pull)
        swarms.log_weights = np.zeros(fitness.size)
        stack.put(swarms, chosen)

    def _fitted(self, stack: Stack, carried: Floats) -> tuple[Floats, Floats]:
        """Means (M, D) and Cholesky factors (M, D, D) of the Gaussians that stand for each node's prediction, (20)."""
        if self.prior_fit == "weighted":
            return fit_weighted(stack.cloud, carried, stack.offsets, RIDGE)
        return fit(stack.cloud, stack.offsets, RIDGE)

    def _fly(
        self, stack: Stack, fitness: Floats, ranks: Floats, likelihood: Score, log_prior: Score,
        pull: tuple[float, float, float, bool],
    ) -> None:  # fmt: skip
        """Replace the stack's cloud by the last of `iterations` states of the chains that start at it. Eqs. (17)-(24).

        `ranks` (N,) are the logs by which the first iteration finds the best particle: χ_0 of eq. (17).
        """
        cloud = stack.cloud
        velocity, best, prior = np.zeros(cloud.shape), cloud.copy(), log_prior(cloud)
        keys = particle_keys(stack.keys, stack.offsets, MOVE)
        for iteration in range(self.iterations):
            # the counter of a particle's random numbers: an iteration uses two per column, and one for the test
            first = iteration * (2 * cloud.shape[0] + 1)
            proposal = fly(cloud, velocity, best, ranks, stack.offsets, keys, first, 1.0, *pull)
            accept(cloud, fitness, prior, proposal, likelihood(proposal), log_prior(proposal), best, ranks, keys, first)

    def _cycles(self, counts: list[int], sensors: list[int], moving: list[bool], steps: int) -> list[float]:
        """The processor cycles that each member spends on its particles, section 5."""
        work = list(zip(sensors, moving, strict=True))
        per_particle = {seen_moves: self._per_particle(*seen_moves, steps) for seen_moves in set(work)}
        return [count * per_particle[seen_moves] for count, seen_moves in zip(counts, work, strict=True)]

    def _per_particle(self, seen: int, moves: bool, steps: int) -> float:
        """Cycles per particle in a step with S readings, section 5.

        40 + 30 S to predict and weigh. A move adds 30 for the Gaussian fit, and 50 + 30 S per iteration.
        """
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
        """Fuse local estimates, weighted by their shares of the particles, renormalised over those that arrived.

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
