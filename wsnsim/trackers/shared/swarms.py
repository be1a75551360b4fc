"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

filtered = filter_swarms(stack, before, likelihood, rules, scene)
move(start, stack, likelihood, log_prior, pull)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.ports import Scene
from wsnsim.base.rng import uniforms
from wsnsim.kernels.gaussian import fit, fit_weighted, log_density
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import moments, systematic, weigh
from wsnsim.kernels.swarm import accept, fly, move_own
from wsnsim.trackers.shared.spread import Likelihood
from wsnsim.trackers.shared.stacks import MOVE, START, Score, Stack

RIDGE = 1e-3
"""m², (m/s)²: added to the diagonal of a fitted covariance, which fewer than five particles leave singular."""


class Predicted(NamedTuple):
    """What a step has made of the particles before they move.

    Attributes:
        before: (D, N) the particles one step ago.
        carried: (N,) their log-weights of the step before, w_{k-1}.
        fitness: (N,) log-likelihoods of the predicted particles.
    """

    before: Floats
    carried: Floats
    fitness: Floats

    def take(self, columns: Ints) -> Predicted:
        """The same of some of the particles; copied."""
        before, carried, fitness = self
        return Predicted(before.take(columns, axis=1), carried.take(columns), fitness.take(columns))


class Pull(NamedTuple):
    """Parameters of the swarm's move: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


class Rules(NamedTuple):
    """When and how swarms move: below which share of effective particles, how far, and five options of `PsoMhpf`."""

    threshold: float
    pull: Pull
    acceptance: str
    prior_fit: str
    ranking: str
    resample_first: bool
    estimate_when: str

    @property
    def has_kernel(self) -> bool:
        """Whether one kernel makes the whole move with these options."""
        return self.acceptance == "gaussian" and self.prior_fit == "weighted" and not self.resample_first


class Filtered(NamedTuple):
    """What a step has made of each member's particles.

    Attributes:
        means: (M, D) the members' own estimates.
        covs: (M, D, D) their covariances.
        effective: (M,) the effective number of particles before the move.
        moving: (M,) whose swarms moved.
    """

    means: Floats
    covs: Floats
    effective: Floats
    moving: Bools


class Start(NamedTuple):
    """Where the chains of a move start.

    Attributes:
        cloud: (D, N) particles; the move replaces them by the last states of the chains.
        fitness: (N,) log-likelihoods of the particles.
        ranks: (N,) logs by which the first iteration finds the best particle: χ_0 of eq. (17).
    """

    cloud: Floats
    fitness: Floats
    ranks: Floats


def filter_swarms(stack: Stack, before: Floats, likelihood: Likelihood, rules: Rules, scene: Scene) -> Filtered:
    """Weigh a stack of predicted particles in place, and move the swarms of those who have few effective ones.

    Eqs. (13)-(24). `before` (D, N) are the particles one step ago.
    """
    carried, fitness = stack.log_weights, likelihood.score(stack)(stack.cloud)
    stack.log_weights = carried + fitness  # eq. 13
    effective = weigh(stack.log_weights, stack.offsets)  # eq. 14
    moving = effective < rules.threshold * stack.counts
    if rules.estimate_when == "before":
        means, covs = moments(stack.cloud, stack.log_weights, stack.offsets)
    if any(moving.tolist()):
        _move_some(stack, Predicted(before, carried, fitness), moving, likelihood, rules, scene)
    if rules.estimate_when == "after":
        means, covs = moments(stack.cloud, stack.log_weights, stack.offsets)  # eq. 16
    return Filtered(means, covs, effective, moving)


def _move_some(
    stack: Stack, predicted: Predicted, moving: Bools, likelihood: Likelihood, rules: Rules, scene: Scene
) -> None:
    """Move the swarms of those who are `moving` (M,) in place of a resampling, and give them equal weights.

    Section 3, step 4. The swarms of all who move are moved in one go, and in one call where there is a kernel for it.
    """
    if rules.has_kernel and len(scene.motion.position) == 2:
        energies = likelihood.energies()
        if energies is not None:
            x, y = scene.motion.position
            move_own(
                stack.cloud, stack.log_weights, predicted.carried, predicted.fitness, stack.offsets, moving,
                stack.layout.log_counts, stack.keys, *energies, (x, y), MOVE, (*rules.pull,), rules.ranking == "weight",
                RIDGE,
            )  # fmt: skip
            return
    _move_in_turn(stack, predicted, moving, likelihood, rules, scene)


def _move_in_turn(
    stack: Stack, predicted: Predicted, moving: Bools, likelihood: Likelihood, rules: Rules, scene: Scene
) -> None:
    """Any likelihood and any option, kernel by kernel."""
    chosen = stack.chosen(moving)
    part = stack.part(chosen)
    before, carried, fitness = predicted.take(chosen.columns)
    reference = fitted_prior(part, carried, rules.prior_fit) if rules.acceptance == "gaussian" else None
    ranks = ranks_of(part, fitness, rules.ranking)
    if rules.resample_first:
        drawn = resampled_columns(part)
        before, part.cloud = before.take(drawn, axis=1), part.cloud.take(drawn, axis=1)
        fitness, ranks = fitness.take(drawn), ranks.take(drawn)
    score = likelihood.among(chosen.rows).score(part)
    log_prior = _log_prior_of(part, before, reference, rules, scene)
    move(Start(part.cloud, fitness, ranks), part, score, log_prior, rules.pull)
    part.log_weights = np.zeros(fitness.size)
    stack.put(part, chosen)


def _log_prior_of(
    stack: Stack, before: Floats, reference: tuple[Floats, Floats] | None, rules: Rules, scene: Scene
) -> Score:
    """(D, N) → (N,) log π of eq. (20), up to a constant of each particle."""
    if reference is not None:
        return lambda points: log_density(points, *reference, stack.offsets)
    if rules.acceptance == "transition":
        return lambda points: scene.motion.log_transition(points, before, scene.dt, scene.previous)
    return lambda points: np.zeros(points.shape[1])


def fitted_prior(stack: Stack, carried: Floats, prior_fit: str) -> tuple[Floats, Floats]:
    """Means (M, D) and Cholesky factors (M, D, D) of the Gaussians that stand for each node's prediction in eq. (20).

    With `prior_fit` 'weighted' the particles have the weights w_{k-1} that they carry, otherwise equal ones.
    """
    if prior_fit == "weighted":
        return fit_weighted(stack.cloud, carried, stack.offsets, RIDGE)
    return fit(stack.cloud, stack.offsets, RIDGE)


def ranks_of(stack: Stack, fitness: Floats, ranking: str) -> Floats:
    """(N,) log χ_0: the log-likelihood, or with `ranking` 'weight' eq. (17), the weight that is normalised on its node.

    The stack's log-weights are those of (14), but their mean on each node is one.
    """
    if ranking == "likelihood":
        return fitness.copy()
    return stack.log_weights - stack.layout.log_counts[stack.layout.owners]


def resampled_columns(stack: Stack) -> Ints:
    """(N,) columns after resampling the particles of each member."""
    return systematic(stack.log_weights, stack.offsets, stack.counts, uniforms(stack.keys, START))


def move(start: Start, stack: Stack, likelihood: Score, log_prior: Score, pull: Pull) -> None:
    """Replace a cloud by the last of `iterations` states of the chains that start at it, in place. Eqs. (17)-(24).

    Segments and keys are the stack's.
    """
    cloud, fitness, best_fitness = start
    velocity, best = np.zeros(cloud.shape), cloud.copy()
    prior = log_prior(cloud)
    keys = particle_keys(stack.keys, stack.offsets, MOVE)
    for iteration in range(pull.iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        proposal = fly(cloud, velocity, best, best_fitness, stack.offsets, keys, draw, 1.0, *pull[1:])
        new_fitness = likelihood(proposal)
        new_prior = log_prior(proposal)
        accept(cloud, fitness, prior, proposal, new_fitness, new_prior, best, best_fitness, keys, draw)
