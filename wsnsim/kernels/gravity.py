"""The gravitational search move of Ruan et al. (2020), eqs. 5-9: likely particles attract the others.

Shapes: points, velocities (Q, N), fitness (N,) log-likelihoods, keys (N,). One iteration uses the N + 1 uniforms from
`draw` on of each particle's key: rand_i that scales v_i is draw 0, rand_ij that scales the pull of j on i is 1 + j.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import exp, uniform
from wsnsim.kernels.particles import NOTHING
from wsnsim.kernels.swarm import LARGEST_STATE


@inlined
def _masses(fitness: Floats) -> Floats:
    """Masses M_i = m_i / Σ m, m_i = (fit_i - worst) / (best - worst) with fit = exp(l - l_max); 1/N if best = worst.

    A fitness that is not finite counts as fit = 0. Eq. (6).
    """
    masses, top, worst, total = np.empty(fitness.size), -np.inf, 1.0, 0.0
    for j in range(fitness.size):
        top = fitness[j] if top < fitness[j] < np.inf else top
    for j in range(fitness.size):
        below = fitness[j] - top
        masses[j] = exp(below) if NOTHING < below <= 0.0 else 0.0
        worst = masses[j] if masses[j] < worst else worst
    for j in range(fitness.size):
        masses[j] -= worst
        total += masses[j]
    for j in range(fitness.size):
        masses[j] = masses[j] / total if total > 0.0 else 1.0 / fitness.size
    return masses


@inlined
def _pulls(points: Floats, masses: Floats, j: int, elite: int) -> bool:
    """Whether particle j attracts others: it has mass, a finite position, and is among the `elite` heaviest.

    Of equal particles the first ones count. Counting the heavier ones is cheaper than the pulls and needs no sort.
    """
    heavier, farthest = 0, 0.0
    for i in range(masses.size):
        heavier += (masses[i] > masses[j]) | ((masses[i] == masses[j]) & (i < j))
    for q in range(points.shape[0]):
        farthest += abs(points[q, j])
    return heavier < max(elite, 1) and masses[j] > 0.0 and farthest < LARGEST_STATE


@inlined
def _add_pulls(
    falls: Floats,
    pull: Floats,
    points: Floats,
    j: int,
    columns: Ints,
    keys: Keys,
    draw: int,
    strength: float,
    softening: float,
    threshold: float,
) -> None:
    """Add the attraction by particle j on those within the threshold; it is zero on j itself. Eqs. (5), (7)."""
    for i in range(keys.size):
        pull[i] = 0.0
    for column in columns:
        centre = points[column, j]
        for i in range(keys.size):
            pull[i] += (centre - points[column, i]) ** 2
    for i in range(keys.size):
        apart = np.sqrt(pull[i])
        felt = apart <= threshold and apart + softening > 0.0
        pull[i] = strength * uniform(keys[i], draw) / (apart + softening) if felt else 0.0
    for q in range(points.shape[0]):
        centre = points[q, j]
        for i in range(keys.size):
            falls[q, i] += pull[i] * (centre - points[q, i])


@kernel
def attract(
    points: Floats,
    velocities: Floats,
    fitness: Floats,
    columns: Ints,
    keys: Keys,
    draw: int,
    gravity: float,
    elite: int,
    softening: float,
    threshold: float = np.inf,
) -> Floats:
    """The points (Q, N) after one iteration; velocities are updated in place.

    a_i = G Σ_{j of the K heaviest, j ≠ i} rand_ij M_j (x_j - x_i) / (R_ij + ε)      eqs. (5), (7), (8)
    v_i = rand_i v_i + a_i, x_i = x_i + v_i                                          eq. (9)

    `gravity` is G, `elite` K, `softening` ε; beyond the `threshold` r of R_ij there is no pull. R_ij is the distance in
    the rows `columns` of the points, which are the position. M_i, which multiplies in (5) and divides in (8), is
    cancelled: it is 0 for the worst particle, which is attracted like any other. There is one scalar rand per ordered
    pair, as we interpret (7). A particle whose new point would be beyond LARGEST_STATE or NaN keeps its point, and its
    velocity becomes 0 (our choice).
    """
    masses, pull = _masses(fitness), np.empty(keys.size)
    falls, proposal = np.zeros(points.shape), np.empty(points.shape)
    for j in range(keys.size):
        if not _pulls(points, masses, j, elite):
            continue
        _add_pulls(falls, pull, points, j, columns, keys, draw + 1 + j, gravity * masses[j], softening, threshold)
    for i in range(keys.size):
        lasting, farthest = uniform(keys[i], draw), 0.0
        for q in range(points.shape[0]):
            velocities[q, i] = lasting * velocities[q, i] + falls[q, i]
            proposal[q, i] = points[q, i] + velocities[q, i]
            farthest += abs(proposal[q, i])
        if not farthest < LARGEST_STATE:
            for q in range(points.shape[0]):
                velocities[q, i], proposal[q, i] = 0.0, points[q, i]
    return proposal
