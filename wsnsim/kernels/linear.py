"""A linear motion with Gaussian noise, x⁺ = F x + L w with w ~ N(0, I), for many states at once.

states (D, N): column j is particle j      transition (D, D): F      root (D, K): L, so that Q = L Lᵀ; K may be below D

Loops over particles are the inner ones. Zero entries of F and L, which are most of them, are skipped.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.kernels.compilation import inner, kernel
from wsnsim.kernels.elementary import LOG_TWO_PI, normal_pair


@inner
def _moved(states: Floats, transition: Floats) -> Floats:
    """F x (D, N), without the zeros of F."""
    result = np.empty(states.shape)
    for d in range(transition.shape[0]):
        row = result[d]
        for j in range(row.size):
            row[j] = 0.0
        for e in range(transition.shape[1]):
            slope, state = transition[d, e], states[e]
            if slope != 0.0:
                for j in range(row.size):
                    row[j] += slope * state[j]
    return result


@kernel
def advance(states: Floats, transition: Floats) -> Floats:
    """The states (D, N) one step later, without noise: F x."""
    return _moved(states, transition)


@kernel
def propagate(states: Floats, keys: Keys, transition: Floats, root: Floats) -> Floats:
    """The states (D, N) one step later: F x + L w. Components 2p and 2p + 1 of w are the key's p-th normal pair."""
    count, inputs = states.shape[1], root.shape[1]
    result = _moved(states, transition)
    first, second = np.empty(count), np.empty(count)
    for k in range(0, inputs, 2):
        for j in range(count):
            first[j], second[j] = normal_pair(keys[j], k // 2)
        for d in range(root.shape[0]):
            along_first, along_second = root[d, k], root[d, k + 1] if k + 1 < inputs else 0.0
            if along_first != 0.0 or along_second != 0.0:
                for j in range(count):
                    result[d, j] += along_first * first[j] + along_second * second[j]
    return result


@kernel
def log_transition(after: Floats, before: Floats, transition: Floats, factor: Floats) -> Floats:
    """Log N(after; F before, Q), (N,); `factor` (D, D) is the lower Cholesky factor of Q. -inf in place of NaN.

    So it is everywhere if the factor's diagonal is not positive.
    """
    size, count = before.shape
    white, result, constant = _moved(before, transition), np.empty(count), 0.0
    for j in range(count):
        result[j] = 0.0
    for d in range(size):
        for j in range(count):
            white[d, j] = after[d, j] - white[d, j]
        for e in range(d):
            slope = factor[d, e]
            if slope != 0.0:
                for j in range(count):
                    white[d, j] -= slope * white[e, j]
        scale = 1.0 / factor[d, d]
        constant -= 0.5 * LOG_TWO_PI + np.log(factor[d, d])
        for j in range(count):
            white[d, j] *= scale
            result[j] += white[d, j] * white[d, j]
    for j in range(count):
        value = constant - 0.5 * result[j]
        result[j] = value if value > -np.inf else -np.inf
    return result
