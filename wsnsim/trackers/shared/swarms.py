"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

move(start, moving, stack, likelihood, log_prior, pull)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.rng import uniforms
from wsnsim.kernels.gaussian import fit, fit_weighted
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import systematic
from wsnsim.kernels.swarm import accept, fly
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


class Pull(NamedTuple):
    """Parameters of the swarm's move: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


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
    ranks: Floats = stack.log_weights - np.log(np.maximum(stack.counts, 1))[stack.layout.owners]
    return ranks


def resampled_columns(stack: Stack, moving: Bools) -> Ints:
    """(N,) columns after resampling the particles of members that are `moving`; the others keep theirs."""
    drawn = systematic(stack.log_weights, stack.offsets, stack.counts, uniforms(stack.keys, START))
    columns: Ints = np.where(moving[stack.layout.owners], drawn, np.arange(drawn.size))
    return columns


def move(start: Start, moving: Bools, stack: Stack, likelihood: Score, log_prior: Score, pull: Pull) -> None:
    """Replace a cloud by the last of `iterations` states of the chains that start at it, in place. Eqs. (17)-(24).

    Segments and keys are the stack's; the particles of members who are not `moving` (M,) stay.
    """
    cloud, fitness, best_fitness = start
    velocity, best = np.zeros(cloud.shape), cloud.copy()
    prior = log_prior(cloud)
    keys = particle_keys(stack.keys, stack.offsets, MOVE)
    for iteration in range(pull.iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        proposal = fly(cloud, velocity, best, best_fitness, stack.offsets, keys, draw, 1.0, *pull[1:])
        new_fitness = likelihood(proposal)
        accept(
            cloud,
            fitness,
            prior,
            proposal,
            new_fitness,
            log_prior(proposal),
            best,
            best_fitness,
            keys,
            draw,
            stack.layout.owners,
            moving,
        )
