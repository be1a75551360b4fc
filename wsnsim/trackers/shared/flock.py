"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

moved(flock, likelihood, log_prior, pull) -> (D, N)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.rng import uniforms
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import systematic
from wsnsim.kernels.swarm import accept, fly
from wsnsim.trackers.shared.stacks import MOVE, START, Score, Stack, cuts_of


@dataclass(frozen=True, slots=True)
class Flock:
    """Particles (D, N) one step before and now, with log-weights and log-likelihoods (N,).

    Segment m, of counts[m] columns from offsets[m] on, is member rows[m]'s; `columns` is where the stack has them.
    """

    before: Floats
    cloud: Floats
    log_weights: Floats
    fitness: Floats
    rows: Ints
    counts: Ints
    offsets: Ints
    keys: Keys
    columns: Ints | slice


class Pull(NamedTuple):
    """How a swarm moves: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


def flock_of(stack: Stack, before: Floats, fitness: Floats, moving: Bools) -> Flock:
    """The particles of the members that move."""
    rows = moving.nonzero()[0]
    if rows.size == moving.size:
        everything = slice(None)
        return Flock(
            before, stack.cloud, stack.log_weights, fitness, rows, stack.counts, stack.offsets, stack.keys, everything
        )
    columns = moving.repeat(stack.counts).nonzero()[0]
    counts = stack.counts[rows]
    return Flock(
        before.take(columns, axis=1),
        stack.cloud.take(columns, axis=1),
        stack.log_weights[columns],
        fitness[columns],
        rows,
        counts,
        cuts_of(counts),
        stack.keys[rows],
        columns,
    )


def resampled_flock(flock: Flock) -> Flock:
    """Each node's particles drawn anew by their weights, as many as before, by systematic resampling."""
    drawn = systematic(flock.log_weights, flock.offsets, flock.counts, uniforms(flock.keys, START))
    return replace(
        flock,
        before=flock.before.take(drawn, axis=1),
        cloud=flock.cloud.take(drawn, axis=1),
        log_weights=np.zeros(drawn.size),
        fitness=flock.fitness[drawn],
    )


def moved(flock: Flock, likelihood: Score, log_prior: Score, pull: Pull) -> Floats:
    """(D, N) the last of `iterations` states of each particle's chain, which starts where it is. Eqs. (17)-(24)."""
    cloud, fitness = flock.cloud.copy(), flock.fitness.copy()
    velocity, best, best_fitness = np.zeros_like(cloud), cloud.copy(), fitness.copy()
    prior = log_prior(cloud)
    keys = particle_keys(flock.keys, flock.offsets, MOVE)
    iterations, *rule = pull
    for iteration in range(iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        proposal = fly(cloud, velocity, best, best_fitness, flock.offsets, keys, draw, *rule)
        new_fitness = likelihood(proposal)
        accept(cloud, fitness, prior, proposal, new_fitness, log_prior(proposal), best, best_fitness, keys, draw)
    return cloud
