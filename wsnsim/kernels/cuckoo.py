"""The moves of a cuckoo search whose nests are particles (Wei, Guo 2022, eqs. 5-10), and two rules to accept them.

Shapes: cloud, proposal (D, N), of which only the rows `rows` (Q,) move; fitness, prior (N,) are logarithms. One flight
uses 4 Q uniforms of each particle's key, from the even number `draw` on: component q takes the normal pair
draw/2 + 2 q for μ and ν, and the first normal of the next pair for α. One replacement uses the uniforms draw (s),
draw + 1 (d) and draw + 2 (e).
"""

from __future__ import annotations

import math

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import LOG_TWO, exp, log, normal_pair, uniform
from wsnsim.kernels.swarm import LARGEST_STATE

MIN_NU = 1e-12
"""Smallest |ν| in a Levy step (our choice)."""
MAX_STEP = 1e3
"""Longest Levy step |s| (our choice)."""


def levy_deviation(exponent: float) -> float:
    """σ_u, the standard deviation of μ in a Levy step of tail exponent λ in (0, 2): 0.6966 for 1.5. Mantegna (1994)."""
    numerator = math.gamma(1.0 + exponent) * math.sin(0.5 * math.pi * exponent)
    denominator = math.gamma(0.5 * (1.0 + exponent)) * exponent * 2.0 ** (0.5 * (exponent - 1.0))
    return float((numerator / denominator) ** (1.0 / exponent))


@inlined
def _levy(key: np.uint64, pair: int, deviation: float, inverse: float) -> tuple[float, float]:
    """μ/σ_u, and the step s = μ/|ν|^(1/λ), cut off at ±MAX_STEP. Eq. (6)."""
    white, nu = normal_pair(key, pair)
    size = abs(nu) if abs(nu) > MIN_NU else MIN_NU
    step = deviation * white * exp(-inverse * log(size))
    return white, min(max(step, -MAX_STEP), MAX_STEP)


@kernel
def fly_cuckoos(
    cloud: Floats,
    best: Floats,
    rows: Ints,
    keys: Keys,
    draw: int,
    alpha: float,
    random_alpha: bool,
    deviation: float,
    exponent: float,
    factor: Floats,
) -> tuple[Floats, Floats]:
    """The cuckoos' proposals about the best nest (D,), and log q(x | x') - log q(x' | x) (N,) of their flights.

    x' = x_best + c (x - x_best) with c = 1 + α s Δk in each component; factor (N,) are the Δk. `random_alpha`: α is
    `alpha` times a standard normal for each component (the paper says random; one per component is our choice). The
    reverse flight has the same ν and α, the factor 1/c and the step -s/c. Given ν and α, c is Gaussian about 1, so that

        q(x | x') / q(x' | x) = exp(g² (1 - 1/c²) / 2) / |c|,   g = μ/σ_u

    It holds if `best` does not depend on x. The ratio is 0 if the step was cut off, or the reverse step would be. A
    component that equals that of the best nest does not move. Eqs. (5), (6), (10); the ratio is our own.
    """
    proposal, log_ratio = cloud.copy(), np.zeros(cloud.shape[1])
    inverse = 1.0 / exponent
    for q in range(rows.size):
        d, pair = rows[q], draw // 2 + 2 * q
        for j in range(cloud.shape[1]):
            white, step = _levy(keys[j], pair, deviation, inverse)
            scale = alpha * factor[j] * (normal_pair(keys[j], pair + 1)[0] if random_alpha else 1.0)
            away = cloud[d, j] - best[d]
            proposal[d, j] = cloud[d, j] + scale * step * away  # eqs. 5, 10: x' = x + α s (x - x_best) Δk
            c = 1.0 + scale * step
            cut = (abs(step) >= MAX_STEP) | (abs(step) >= MAX_STEP * abs(c))
            size = 1.0 if cut else abs(c)
            term = 0.5 * white * white * (1.0 - 1.0 / (size * size)) - log(size)
            log_ratio[j] += 0.0 if away == 0.0 else (-np.inf if cut else term)
    return proposal, log_ratio


@kernel
def replace_nests(cloud: Floats, nests: Floats, rows: Ints, keys: Keys, draw: int, keep: float) -> Floats:
    """The proposals (D, N) of the replacement: x + s (x_d - x_e) if s > P, else x, with s ~ U(0, 1). Eq. (7).

    As printed, `keep` = P is a probability of *keeping*, and the same s is compared with P and scales the step. d and e
    are drawn with replacement from `nests` (D, M), independently of each other and of the particle (our choice; the
    paper: random). Without nests no particle moves.
    """
    proposal, count = cloud.copy(), nests.shape[1]
    for j in range(cloud.shape[1] if count > 0 else 0):
        s = uniform(keys[j], draw)
        if s > keep:
            nest_d, nest_e = int(count * uniform(keys[j], draw + 1)), int(count * uniform(keys[j], draw + 2))
            for q in range(rows.size):
                row = rows[q]
                proposal[row, j] = cloud[row, j] + s * (nests[row, nest_d] - nests[row, nest_e])
    return proposal


@inlined
def _is_valid(proposal: Floats, j: int) -> bool:
    """Whether all components of the j-th state are numbers within ±LARGEST_STATE."""
    valid = True
    for d in range(proposal.shape[0]):
        valid = valid & (abs(proposal[d, j]) < LARGEST_STATE)
    return valid


@kernel
def accept_greedy(cloud: Floats, fitness: Floats, proposal: Floats, proposal_fitness: Floats) -> int:
    """Accept proposals that are fitter, in place in cloud and fitness; return their number.

    A proposal whose fitness is NaN or whose state is beyond LARGEST_STATE is rejected.
    """
    accepted = 0
    for j in range(fitness.size):
        if proposal_fitness[j] > fitness[j] and _is_valid(proposal, j):
            accepted += 1
            fitness[j] = proposal_fitness[j]
            for d in range(cloud.shape[0]):
                cloud[d, j] = proposal[d, j]
    return accepted


@kernel
def accept_chains(
    cloud: Floats,
    fitness: Floats,
    prior: Floats,
    proposal: Floats,
    proposal_fitness: Floats,
    proposal_prior: Floats,
    log_ratio: Floats,
    keys: Keys,
    draw: int,
) -> int:
    """Accept proposals by a Metropolis-Hastings test, in place in cloud, fitness and prior; return their number.

    A proposal is accepted if the `draw`-th uniform of the key is below the ratio of p(z|x') p(x'|ancestor) q(x|x') and
    the same with x and x' exchanged, in logs. It is rejected if the ratio is NaN or the state is beyond
    LARGEST_STATE. This test is our repair; the paper does not have it.
    """
    accepted = 0
    for j in range(fitness.size):
        ratio = proposal_fitness[j] + proposal_prior[j] - fitness[j] - prior[j] + log_ratio[j]
        if log(uniform(keys[j], draw)) < ratio and _is_valid(proposal, j):
            accepted += 1
            fitness[j], prior[j] = proposal_fitness[j], proposal_prior[j]
            for d in range(cloud.shape[0]):
                cloud[d, j] = proposal[d, j]
    return accepted


@kernel
def relative_changes(fitness: Floats, before: Floats) -> Floats:
    """The changes Δk = |(f - f_before) / f_before| (N,) of fitnesses given as logarithms, at most 1. Eq. (10).

    The paper's is not bounded: the limit of 1 is our choice, as is the value 1 for 0/0.
    """
    changes = np.empty(fitness.size)
    for j in range(fitness.size):
        gain = fitness[j] - before[j]
        changes[j] = abs(exp(gain) - 1.0) if gain < LOG_TWO else 1.0
    return changes
