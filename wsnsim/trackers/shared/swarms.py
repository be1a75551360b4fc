"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

moved(cloud, fitness, stack, likelihood, log_prior, pull) -> (D, N)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.rng import uniforms
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import systematic
from wsnsim.kernels.swarm import accept, fly
from wsnsim.trackers.shared.stacks import MOVE, START, Score, Stack


class Pull(NamedTuple):
    """How a swarm moves: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


def resampled_columns(stack: Stack) -> Ints:
    """(N,) each node's particles drawn anew by their weights, as many as before, by systematic resampling."""
    return systematic(stack.log_weights, stack.offsets, stack.counts, uniforms(stack.keys, START))


def moved(cloud: Floats, fitness: Floats, stack: Stack, likelihood: Score, log_prior: Score, pull: Pull) -> Floats:
    """(D, N) the last of `iterations` states of each particle's chain, which starts at `cloud`. Eqs. (17)-(24).

    `fitness` (N,) are the log-likelihoods at the start; the nodes' segments and keys are the stack's.
    """
    cloud, fitness = cloud.copy(), fitness.copy()
    velocity, best, best_fitness = np.zeros_like(cloud), cloud.copy(), fitness.copy()
    prior = log_prior(cloud)
    keys = particle_keys(stack.keys, stack.offsets, MOVE)
    iterations, *rule = pull
    for iteration in range(iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        proposal = fly(cloud, velocity, best, best_fitness, stack.offsets, keys, draw, *rule)
        new_fitness = likelihood(proposal)
        accept(cloud, fitness, prior, proposal, new_fitness, log_prior(proposal), best, best_fitness, keys, draw)
    return cloud
