"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

move(cloud, fitness, moving, stack, likelihood, log_prior, pull)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.rng import uniforms
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import systematic
from wsnsim.kernels.swarm import accept, fly
from wsnsim.trackers.shared.stacks import MOVE, START, Score, Stack


class Pull(NamedTuple):
    """Parameters of the swarm's move: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


def resampled_columns(stack: Stack, moving: Bools) -> Ints:
    """(N,) columns after resampling the particles of members that are `moving`; the others keep theirs."""
    drawn = systematic(stack.log_weights, stack.offsets, stack.counts, uniforms(stack.keys, START))
    columns: Ints = np.where(moving[stack.layout.owners], drawn, np.arange(drawn.size))
    return columns


def move(
    cloud: Floats, fitness: Floats, moving: Bools, stack: Stack, likelihood: Score, log_prior: Score, pull: Pull
) -> None:
    """Make a cloud (D, N) the last of `iterations` states of the chains that start at it, in place. Eqs. (17)-(24).

    `fitness` (N,) are the log-likelihoods at the start. Segments and keys are the stack's; the particles of members
    who are not `moving` (M,) stay.
    """
    velocity, best, best_fitness = np.zeros(cloud.shape), cloud.copy(), fitness.copy()
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
