"""The motion model of bounded velocity (Jiang, Song, Lin 2013, eqs. 1-4), for many states at once.

drift = (T, a, c1, c2)               the constants of A: step, bound, and the factors of the pull
root = (l11, l21, l22)               the lower Cholesky factor of one axis' process covariance
states (4, N): rows px, vx, py, vy; the axes move independently of each other
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import normal_pair

Drift: TypeAlias = tuple[float, float, float, float]
Root: TypeAlias = tuple[float, float, float]


@inlined
def _drifted(position: float, velocity: float, drift: Drift) -> tuple[float, float]:
    """One axis after a step without noise: F1 while |p| <= a, else F2, which pulls it back and slows it (eqs. 2-3)."""
    step, bound, c1, c2 = drift
    pull = c1 * position + c2 * velocity
    pull = 0.0 if abs(position) <= bound else pull
    return position + step * velocity, velocity - step * pull


@kernel
def advance(states: Floats, drift: Drift) -> Floats:
    """States (4, N) after a step without noise: A(x) x."""
    result = np.empty(states.shape)
    for axis in range(0, 4, 2):
        for j in range(states.shape[1]):
            result[axis, j], result[axis + 1, j] = _drifted(states[axis, j], states[axis + 1, j], drift)
    return result


@kernel
def transitions(states: Floats, drift: Drift) -> Floats:
    """Transition matrices (N, 4, 4): A(x) at each state (eqs. 2-3)."""
    step, bound, c1, c2 = drift
    result = np.empty((states.shape[1], 4, 4))
    for j in range(states.shape[1]):
        for d in range(4):
            for e in range(4):
                result[j, d, e] = 0.0
        for axis in range(0, 4, 2):
            beyond = 0.0 if abs(states[axis, j]) <= bound else 1.0
            result[j, axis, axis] = 1.0
            result[j, axis, axis + 1] = step
            result[j, axis + 1, axis] = -step * c1 * beyond
            result[j, axis + 1, axis + 1] = 1.0 - step * c2 * beyond
    return result


@kernel
def propagate(states: Floats, keys: Keys, drift: Drift, root: Root) -> Floats:
    """States (4, N) after a step: A(x) x + w.

    Axis x takes the first pair of normals of the particle's key, axis y the second.
    """
    l11, l21, l22 = root
    result = np.empty(states.shape)
    for axis in range(0, 4, 2):
        for j in range(states.shape[1]):
            position, velocity = _drifted(states[axis, j], states[axis + 1, j], drift)
            first, second = normal_pair(keys[j], axis // 2)
            result[axis, j] = position + l11 * first
            result[axis + 1, j] = velocity + l21 * first + l22 * second
    return result


@kernel
def log_transition(after: Floats, before: Floats, drift: Drift, root: Root) -> Floats:
    """(N,) log N(after; A(before) before, covariance), -inf instead of NaN. l11 and l22 must not be zero."""
    l11, l21, l22 = root
    constant = -2.0 * np.log(2.0 * np.pi) - 2.0 * np.log(l11 * l22)
    result = np.empty(before.shape[1])
    for j in range(result.size):
        square = 0.0
        for axis in range(0, 4, 2):
            position, velocity = _drifted(before[axis, j], before[axis + 1, j], drift)
            first = (after[axis, j] - position) / l11
            second = (after[axis + 1, j] - velocity - l21 * first) / l22
            square += first * first + second * second
        result[j] = constant - 0.5 * square if square < np.inf else -np.inf
    return result
