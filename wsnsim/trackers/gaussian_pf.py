"""Particle filters that keep one Gaussian between steps and never resample: GPF, PSO-GPF and GSA-GPF.

Ruan, Wang, Yang, Zhang (2020), after Kotecha, Djurić (2003). Requests of a step:

    Gather: readings  Compute

A step samples particles from the Gaussian, predicts them, may move them towards the readings, weights them by the
likelihood, and computes mean and covariance. With a move this is a heuristic: the particles are no longer samples of
the prediction, and their weights do not compensate for it. The 1/N in the paper's step 5 is left out, since its weights
are normalised already. Without a reading no particles are sampled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Member
from wsnsim.kernels.gaussian import sample
from wsnsim.kernels.gravity import attract
from wsnsim.kernels.swarm import LARGEST_STATE, fly
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES, Pool
from wsnsim.trackers.shared.gains import gain_prior
from wsnsim.trackers.shared.heads import (
    MOVE_CYCLES,
    WEIGH_CYCLES,
    CloudBelief,
    GaussianBelief,
    LateFilter,
    keys_of,
    only_predicted,
    score_of,
    summary,
    weighed_with_gains,
)
from wsnsim.trackers.shared.readings import gather_readings
from wsnsim.trackers.shared.stacks import DRAW, MOVE, Score, place_of, propagated_by, snapshot
from wsnsim.trackers.shared.whole_runs import gaussian_runs

PAIR_CYCLES = 20.0
"""CPU cycles to pull one particle towards another: a distance, a random number, a quotient, a sum (our count)."""

Move = Literal["position", "all"]


@part
class HeadSampling(LateFilter):
    """What the three have in common. A tracker gives `moved(cloud, score, scene)` and `move_cycles`."""

    particles: Annotated[int, Quantity("", ge=1, le=10**6), "N: particles sampled at each step"] = 100

    @property
    def evaluations(self) -> int:
        """How many likelihoods of all readings one particle costs in one step: at the start, and after each move."""
        return 1 + int(getattr(self, "iterations", 0))

    @property
    def move_cycles(self) -> float:
        """Operations of the whole move of one step, its likelihoods apart."""
        return 0.0

    def moved(self, cloud: Floats, score: Score, scene: Scene) -> tuple[Floats, Floats]:
        """The predicted particles (D, N) where they are weighed, and their log-likelihoods (N,) there."""
        raise NotImplementedError

    def one_step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head, which does the rest; without any, the Gaussian is predicted.

        Where no particle is likely, all weigh the same.
        """
        seen = yield from gather_readings(scene)
        if not seen.ids:
            yield Compute(PREDICT_CYCLES * scene.steps)
            return only_predicted(belief, scene)
        yield Compute(self._cycles(len(seen.ids), scene.steps))
        keys = keys_of(scene, self.particles, DRAW)
        drawn, _ = sample(np.ascontiguousarray(belief.mean[:, None]), np.ascontiguousarray(belief.cov[None]), keys)
        _, predicted = propagated_by(scene.key, drawn, scene)
        if gain_prior(scene.sensor):
            return (yield from weighed_with_gains(belief, drawn, predicted, seen, scene))
        cloud, log_weights = self.moved(predicted, score_of(seen, scene), scene)
        mean, cov, effective = summary(cloud, log_weights)
        return CloudBelief(mean, cov, scene.head, effective, Pool(cloud, log_weights))

    def snapshot(self, belief: GaussianBelief, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(head, particles (D, n), weights (n,)) of this step, which the next will not use; none without a reading."""
        if isinstance(belief, CloudBelief):
            yield from snapshot([(belief.head, belief.pool.cloud, belief.pool.log_weights)])

    def _cycles(self, readings: int, steps: int) -> float:
        """CPU cycles: to draw and to predict a particle 40 each, a likelihood 30 S; and the move."""
        a_particle = PREDICT_CYCLES * (1 + steps) + WEIGH_CYCLES * readings * self.evaluations
        return a_particle * self.particles + self.move_cycles


@part
class GaussianPf(HeadSampling):
    """GPF: particles sampled from N(μ, Σ), predicted, weighted by the likelihood and fitted by N(μ', Σ')."""

    estimates_gains: ClassVar[bool] = True

    def moved(self, cloud: Floats, score: Score, scene: Scene) -> tuple[Floats, Floats]:
        """The predicted particles, unmoved, and their log-likelihoods."""
        return cloud, score(cloud)

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """All steps of many standalone runs: `WholeRuns`; not with gains that are estimated."""
        if gain_prior(block.sensor):
            return None
        outcome = gaussian_runs(block, self.particles)
        return outcome.closed(outcome.sums(lambda count: self._cycles(count, 1) if count else PREDICT_CYCLES))


@part
class SwarmGaussianPf(HeadSampling):
    """PSO-GPF: the predicted particles move as a swarm with the likelihood as fitness before they are weighted.

    v = w v + c1 r1 (own best - x) + c2 r2 (swarm's best - x), x = x + v, always accepted. The particles are weighted at
    their last positions, not at their best ones. The paper gives no parameters: w, c1 and c2 are the usual constants of
    a convergent swarm, and all four are our choice.
    """

    iterations: Annotated[int, Quantity("", ge=0, le=1000), "moves of the swarm per step"] = 10
    inertia: Annotated[float, Quantity("", ge=0, le=1), "w: what remains of a velocity"] = 0.729
    c1: Annotated[float, Quantity("", ge=0, le=1000), "pull towards the particle's own best"] = 1.494
    c2: Annotated[float, Quantity("", ge=0, le=1000), "pull towards the swarm's best"] = 1.494
    move: Annotated[Move, "whether the position alone or the whole state moves"] = "position"

    @property
    def move_cycles(self) -> float:
        """50 operations per particle and move."""
        return MOVE_CYCLES * self.particles * self.iterations

    def moved(self, cloud: Floats, score: Score, scene: Scene) -> tuple[Floats, Floats]:
        """The swarm's last positions and their log-likelihoods."""
        rows, _ = _moving(self.move, scene)
        keys, everyone = keys_of(scene, self.particles, MOVE), np.array([0, self.particles])
        fitness, points = score(cloud), np.ascontiguousarray(cloud[rows])
        velocities, best, best_fitness = np.zeros(points.shape), points.copy(), fitness.copy()
        for iteration in range(self.iterations):
            draw = iteration * 2 * len(points)
            rule = (self.inertia, self.c1, self.c2, 1.0, True)
            flown = fly(points, velocities, best, best_fitness, everyone, keys, draw, *rule)
            points = np.clip(flown, -LARGEST_STATE, LARGEST_STATE)
            cloud, fitness = _scored(cloud, rows, points, score)
            better = fitness > best_fitness
            best = np.where(better, points, best)
            best_fitness = np.where(better, fitness, best_fitness)
        return cloud, fitness


@part
class GravitationalGaussianPf(HeadSampling):
    """GSA-GPF: the predicted particles attract each other by their likelihoods before they are weighted. Eqs. (5)-(9).

    In iteration t = 1 ... T_c, G = G0 exp(-α t / T_c). The K = round(N + (1 - N)(t - 1)/(T_c - 1)) heaviest attract.
    G0 = 100 is usual in searches of a box of that size. Since masses sum to one and the attraction does not decrease
    with the distance, a particle moves up to 13.5 m in the first move, which disperses a cloud of one metre. That is
    the literal form and the default. `acceptance: greedy` moves a particle only if its likelihood increases; a smaller
    `G0` is the other repair.

    Our choice, since the paper does not say: `move: position` (literal is `all`: the distance does not include the
    velocity, whose change is then unbounded), the softening ε, and a velocity that is kept after a rejected move.
    Step 3 initialises a "perception threshold r" that the paper neither defines nor gives: `threshold` lets a particle
    feel only those of the elite that are within r [our reading]; without it, all.
    """

    particles: Annotated[
        int, Quantity("", ge=1, le=10_000), "N: particles drawn at each step; the work grows with their square"
    ] = 100
    iterations: Annotated[int, Quantity("", ge=0, le=1000), "T_c: moves per step"] = 10
    G0: Annotated[float, Quantity("", ge=0, le=1e9), "how strongly particles attract each other at first"] = 100.0
    alpha: Annotated[float, Quantity("", ge=0, le=1e6), "α: how fast the attraction decays over the moves"] = 20.0
    softening: Annotated[float, Quantity("m", ge=1e-12, le=1e6), "ε: added to the distance of two particles"] = 1e-6
    threshold: Annotated[
        float | None, Quantity("m", gt=0, le=1e9), "r: how far a particle perceives others; default: without limit"
    ] = None
    acceptance: Annotated[Literal["always", "greedy"], "whether a move is always accepted, or only if it is fitter"] = (
        "always"
    )
    move: Annotated[Move, "whether the position alone or the whole state moves"] = "position"

    @property
    def move_cycles(self) -> float:
        """20 for each particle that is pulled by each of the elite, move by move."""
        pulling = sum(elite_size(self.particles, t, self.iterations) for t in range(1, self.iterations + 1))
        return PAIR_CYCLES * self.particles * pulling

    def moved(self, cloud: Floats, score: Score, scene: Scene) -> tuple[Floats, Floats]:
        """The particles after T_c moves and their log-likelihoods."""
        rows, places = _moving(self.move, scene)
        keys, fitness = keys_of(scene, self.particles, MOVE), score(cloud)
        velocities, reach = np.zeros(cloud[rows].shape), math.inf if self.threshold is None else self.threshold
        for t in range(1, self.iterations + 1):
            gravity = self.G0 * math.exp(-self.alpha * t / self.iterations)
            elite, draw = elite_size(self.particles, t, self.iterations), (t - 1) * (self.particles + 1)
            points = np.ascontiguousarray(cloud[rows])
            pulled = attract(points, velocities, fitness, places, keys, draw, gravity, elite, self.softening, reach)
            after, after_fitness = _scored(cloud, rows, pulled, score)
            if self.acceptance == "greedy":
                fitter = after_fitness > fitness
                after, after_fitness = np.where(fitter, after, cloud), np.where(fitter, after_fitness, fitness)
            cloud, fitness = after, after_fitness
        return cloud, fitness


def elite_size(particles: int, t: int, iterations: int) -> int:
    """K = round(N + (1 - N)(t - 1)/(T_c - 1)): from N in iteration t = 1 to 1 in the last; N if there is only one."""
    if iterations == 1:
        return particles
    return math.floor(particles + (1 - particles) * (t - 1) / (iterations - 1) + 0.5)


def _moving(move: Move, scene: Scene) -> tuple[slice | list[int], np.ndarray]:
    """Which rows of a cloud move, and which of those are the position."""
    position = scene.motion.position
    if move == "all":
        return slice(None), np.array(position)
    return place_of(scene), np.arange(len(position))


def _scored(cloud: Floats, rows: slice | list[int], points: Floats, score: Score) -> tuple[Floats, Floats]:
    """A cloud with these rows put in, and its log-likelihoods."""
    after = cloud.copy()
    after[rows] = points
    return after, score(after)
