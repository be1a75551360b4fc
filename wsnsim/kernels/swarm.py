"""The particle-swarm move and its Metropolis-Hastings test (Jiang 2013, section 3), for the swarms of many nodes.

Shapes: cloud, velocity, best (D, N); fitness (N,) log-likelihoods; offsets (M + 1,) cut the columns into nodes. One
iteration uses the 2 D + 1 uniforms from `draw` on of each particle's key: r1 and r2 of component d are draws 2d and
2d + 1, u is the last.
"""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import kernel
from wsnsim.kernels.elementary import log
from wsnsim.kernels.noise import uniform

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
