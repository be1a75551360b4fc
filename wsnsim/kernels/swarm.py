"""The particle-swarm move and its Metropolis-Hastings test (Jiang 2013, section 3), for the swarms of many nodes.

Shapes: cloud, velocity, best (D, N); fitness (N,) log-likelihoods; offsets (M + 1,) cut the columns into nodes. One
iteration uses the 2 D + 1 uniforms from `draw` on of each particle's key: r1 and r2 of component d are draws 2d and
2d + 1, u is the last.

The whole move of the swarms of those members that move (step 4) is one call, which calls the kernels that do the same
one by one, in the same order. Its keys, readings and gains are (M,).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.kernels.acoustic import Law, own_log_likelihood
from wsnsim.kernels.compilation import inner, kernel
from wsnsim.kernels.elementary import log, particle_keys, uniform
from wsnsim.kernels.gaussian import fit_weighted, log_density

LARGEST_STATE = 1e9
"""A state with a larger component is invalid (our choice): a diverging swarm fails without overflowing."""


@kernel
def fly(
    cloud: Floats,
    velocity: Floats,
    best: Floats,
    best_fitness: Floats,
    offsets: Ints,
    keys: Keys,
    draw: int,
    inertia: float,
    phi1: float,
    phi2: float,
    length: float,
    random_factors: bool,
) -> Floats:
    """The proposals (D, N) of the swarm; velocities are updated in place, whether the move is accepted later or not.

    gB is the best that any particle of the *same node* has been so far (our choice: a node knows no other's).
    Eqs. (18), (19), with an inertia factor on V that is 1 there.
    """
    proposal = np.empty(cloud.shape)
    for m in range(offsets.size - 1):
        leader, top = offsets[m], -np.inf
        for j in range(offsets[m], offsets[m + 1]):
            if best_fitness[j] > top:
                leader, top = j, best_fitness[j]
        for d in range(cloud.shape[0]):
            at_best = best[d, leader] if offsets[m] < offsets[m + 1] else 0.0
            for j in range(offsets[m], offsets[m + 1]):
                r1 = uniform(keys[j], draw + 2 * d) if random_factors else 1.0
                r2 = uniform(keys[j], draw + 2 * d + 1) if random_factors else 1.0
                # eq. 18: V += phi1 r1 (pB - x) + phi2 r2 (gB - x)
                own, common = best[d, j] - cloud[d, j], at_best - cloud[d, j]
                v = inertia * velocity[d, j] + phi1 * r1 * own + phi2 * r2 * common
                velocity[d, j] = v
                proposal[d, j] = cloud[d, j] + v * length  # eq. 19
    return proposal


@kernel
def accept(
    cloud: Floats,
    fitness: Floats,
    prior: Floats,
    proposal: Floats,
    proposal_fitness: Floats,
    proposal_prior: Floats,
    best: Floats,
    best_fitness: Floats,
    keys: Keys,
    draw: int,
) -> int:
    """Accept or reject proposals, in place in cloud, fitness, prior and the particles' own best; return the number.

    A proposal is accepted if u < min(r, 1), r = [p(z|x') π(x')] / [p(z|x) π(x)], in logs. It is rejected if the ratio
    is NaN or the state is beyond LARGEST_STATE. Eqs. (20)-(24), with the ratio of the Q taken as one.
    """
    limits = np.empty(keys.size)
    for j in range(keys.size):
        limits[j] = log(uniform(keys[j], draw + 2 * cloud.shape[0]))
    accepted = 0
    for j in range(keys.size):
        farthest = 0.0
        for d in range(cloud.shape[0]):
            farthest = max(farthest, abs(proposal[d, j]))
        ratio = proposal_fitness[j] + proposal_prior[j] - fitness[j] - prior[j]
        if limits[j] < ratio and farthest < LARGEST_STATE:
            accepted += 1
            fitness[j], prior[j] = proposal_fitness[j], proposal_prior[j]
            for d in range(cloud.shape[0]):
                cloud[d, j] = proposal[d, j]
        if fitness[j] > best_fitness[j]:
            best_fitness[j] = fitness[j]
            for d in range(cloud.shape[0]):
                best[d, j] = cloud[d, j]
    return accepted


Pull: TypeAlias = tuple[int, float, float, float, bool]
"""Iterations, phi1, phi2, the factor of the velocity, and whether random factors scale the pulls."""


@inner
def _columns(offsets: Ints, moving: Bools) -> tuple[Ints, Ints, Ints, Ints]:
    """The columns of members that move, with their owners (n,); these members (m,), and where theirs begin (m + 1,)."""
    members = columns = 0
    for m in range(moving.size):
        if moving[m]:
            members += 1
            columns += offsets[m + 1] - offsets[m]
    chosen, owners = np.empty(columns, np.int64), np.empty(columns, np.int64)
    rows, cuts = np.empty(members, np.int64), np.empty(members + 1, np.int64)
    k = n = 0
    for m in range(moving.size):
        if moving[m]:
            rows[k], cuts[k] = m, n
            for j in range(offsets[m], offsets[m + 1]):
                chosen[n], owners[n] = j, k
                n += 1
            k += 1
    cuts[members] = columns
    return chosen, owners, rows, cuts


@inner
def _put(cloud: Floats, log_weights: Floats, places: Ints, some: Floats) -> None:
    """Write those columns of a cloud, and give them equal weights."""
    for j in range(places.size):
        for d in range(cloud.shape[0]):
            cloud[d, places[j]] = some[d, j]
        log_weights[places[j]] = 0.0


@kernel
def move_own(
    cloud: Floats,
    log_weights: Floats,
    carried: Floats,
    fitness: Floats,
    offsets: Ints,
    moving: Bools,
    log_counts: Floats,
    keys: Keys,
    readings: Floats,
    positions: Floats,
    gains: Floats,
    law: Law,
    place: tuple[int, int],
    tag: int,
    pull: Pull,
    ranked: bool,
    ridge: float,
) -> None:
    """Move the swarms of members who are `moving` (M,), each with its own reading; in place in cloud and log-weights.

    Args:
        cloud: (D, N) predicted particles; afterwards the last states of their chains.
        log_weights: (N,) normalised on each member; afterwards zero where a swarm moved.
        carried: (N,) log-weights before this step.
        fitness: (N,) log-likelihoods of the predicted particles.
        offsets: (M + 1,) where the columns of each member begin, and the last one's end.
        moving: (M,) whose swarms move.
        log_counts: (M,) the log of each member's number of particles.
        keys: (M,) the members' keys of this step.
        readings: (M,) with the sensors' positions (M, 2), gains (M,) and law.
        positions: See `readings`.
        gains: See `readings`.
        law: See `readings`.
        place: The rows of the cloud that are x and y.
        tag: What the keys serve here.
        pull: See `Pull`.
        ranked: Whether χ_0 is the weight (eq. 17), or else the likelihood.
        ridge: Added to the diagonal of a fitted covariance.
    """
    iterations, phi1, phi2, length, random_factors = pull
    chosen, owners, rows, cuts = _columns(offsets, moving)
    some, best = cloud[:, chosen], cloud[:, chosen]
    fits, before, velocity = fitness[chosen], carried[chosen], np.zeros(some.shape)
    ranks = (log_weights if ranked else fitness)[chosen]
    if ranked:
        for j in range(chosen.size):
            ranks[j] -= log_counts[rows[owners[j]]]
    places = positions[rows]
    heard, loud, particles = readings[rows], gains[rows], particle_keys(keys[rows], cuts, tag)
    means, factors = fit_weighted(some, before, cuts, ridge)
    prior = log_density(some, means, factors, cuts)
    for iteration in range(iterations):
        draw = iteration * (2 * cloud.shape[0] + 1)
        new = fly(some, velocity, best, ranks, cuts, particles, draw, 1.0, phi1, phi2, length, random_factors)
        likelihood = own_log_likelihood(new[place[0]], new[place[1]], heard, places, loud, owners, law)
        accept(some, fits, prior, new, likelihood, log_density(new, means, factors, cuts), best, ranks, particles, draw)
    _put(cloud, log_weights, chosen, some)
