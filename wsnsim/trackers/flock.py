"""The swarms that move in place of a resampling (Jiang 2013, section 3, step 4): many nodes' particles, end to end.

moved(flock, likelihood, log_prior, pull) -> (D, N)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.rng import uniforms
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import systematic
from wsnsim.kernels.swarm import accept, fly
from wsnsim.trackers.stacks import MOVE, START, OwnReadings, SharedReadings, Stack


@dataclass(frozen=True, slots=True)
class Flock:
    """Particles (D, N) one step before and now, with log-weights and log-likelihoods (N,).

    Segment m, between offsets[m] and offsets[m + 1], is member rows[m]'s; `columns` (N,) is where the stack has them.
    """

    before: Floats
    cloud: Floats
    log_weights: Floats
    fitness: Floats
    rows: Ints
    offsets: Ints
    keys: Keys
    columns: Ints


class Pull(NamedTuple):
    """How a swarm moves: eqs. (18), (19)."""

    iterations: int
    phi1: float
    phi2: float
    length: float
    random_factors: bool


def flock_of(stack: Stack, before: Floats, fitness: Floats, moving: Bools) -> Flock:
    """The particles of the members that move."""
    rows = np.flatnonzero(moving)
    columns = np.flatnonzero(np.repeat(moving, stack.counts))
    offsets = np.zeros(rows.size + 1, np.int64)
    np.cumsum(stack.counts[rows], out=offsets[1:])
    return Flock(
        before=np.take(before, columns, axis=1),
        cloud=np.take(stack.cloud, columns, axis=1),
        log_weights=stack.log_weights[columns],
        fitness=fitness[columns],
        rows=rows,
        offsets=offsets,
        keys=stack.keys[rows],
        columns=columns,
    )


def resampled_flock(flock: Flock) -> Flock:
    """Each node's particles drawn anew by their weights, as many as before, by systematic resampling."""
    drawn = systematic(flock.log_weights, flock.offsets, np.diff(flock.offsets), uniforms(flock.keys, START))
    return Flock(
        before=np.take(flock.before, drawn, axis=1),
        cloud=np.take(flock.cloud, drawn, axis=1),
        log_weights=np.zeros(drawn.size),
        fitness=flock.fitness[drawn],
        rows=flock.rows,
        offsets=flock.offsets,
        keys=flock.keys,
        columns=flock.columns,
    )


def moved(
    flock: Flock, likelihood: OwnReadings | SharedReadings, log_prior: Callable[[Floats], Floats], pull: Pull
) -> Floats:
    """(D, N) the last of `iterations` states of each particle's chain, which starts where it is. Eqs. (17)-(24)."""
    cloud, fitness = flock.cloud.copy(), flock.fitness.copy()
    velocity, best, best_fitness = np.zeros_like(cloud), cloud.copy(), fitness.copy()
    prior = log_prior(cloud)
    keys = particle_keys(flock.keys, flock.offsets, MOVE)
    iterations, *rule = pull
    for iteration in range(iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        proposal = fly(cloud, velocity, best, best_fitness, flock.offsets, keys, draw, *rule)
        new_fitness = likelihood(proposal, flock.rows, flock.offsets)
        accept(cloud, fitness, prior, proposal, new_fitness, log_prior(proposal), best, best_fitness, keys, draw)
    return cloud
