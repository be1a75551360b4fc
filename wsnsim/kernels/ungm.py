"""The univariate nonstationary growth model and its squared reading, for many states at once.

    x⁺ = x/2 + 25 x/(1 + x²) + 8 cos(ω t) + w       t: the time of x, the earlier state       z = x²/20 + v

law = (ω, standard deviation of w). States are (1, N), points x (N,). The log-likelihood is -inf for a point that is not
finite and for a reading that is NaN.

Source: Wei, Guo (2022), experiment 1; there u numbers the new state, and ω t is 1.2 (u - 1).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import LOG_TWO_PI, normal_pair

Law: TypeAlias = tuple[float, float]


@inlined
def _grown(x: float, push: float) -> float:
    """The next state without noise; `push` is its 8 cos(ω t), the same for all."""
    return 0.5 * x + 25.0 * x / (1.0 + x * x) + push


@inlined
def _close(result: Floats, x: Floats, count: int, variance: float) -> None:
    """From the sum of (z - x²/20)² of `count` readings to their log-likelihood; -inf where nothing is known."""
    constant = -0.5 * count * (LOG_TWO_PI + np.log(variance))
    scale = -0.5 / variance
    for j in range(x.size):
        value = constant + scale * result[j]
        result[j] = value if (value > -np.inf) & (abs(x[j]) < np.inf) else -np.inf


@kernel
def advance(states: Floats, law: Law, time: float) -> Floats:
    """(1, N) the states one step later, without noise."""
    push = 8.0 * np.cos(law[0] * time)
    result = np.empty(states.shape)
    for j in range(states.shape[1]):
        result[0, j] = _grown(states[0, j], push)
    return result


@kernel
def propagate(states: Floats, keys: Keys, law: Law, time: float) -> Floats:
    """(1, N) the states one step later, with the first normal of each key times the standard deviation."""
    rate, deviation = law
    push = 8.0 * np.cos(rate * time)
    result = np.empty(states.shape)
    for j in range(states.shape[1]):
        result[0, j] = _grown(states[0, j], push) + deviation * normal_pair(keys[j], 0)[0]
    return result


@kernel
def log_transition(after: Floats, before: Floats, law: Law, time: float) -> Floats:
    """(N,) log N(after; the next state of before, deviation²), -inf where it is not a number. No deviation of zero."""
    rate, deviation = law
    push = 8.0 * np.cos(rate * time)
    constant = -0.5 * LOG_TWO_PI - np.log(deviation)
    result = np.empty(before.shape[1])
    for j in range(result.size):
        white = (after[0, j] - _grown(before[0, j], push)) / deviation
        result[j] = constant - 0.5 * white * white if white * white < np.inf else -np.inf
    return result


@kernel
def joint_log_likelihood(x: Floats, readings: Floats, variance: float) -> Floats:
    """(N,) log p(all S readings | state x)."""
    result = np.zeros(x.size)
    for s in range(readings.size):
        for j in range(x.size):
            result[j] += (readings[s] - x[j] * x[j] / 20.0) ** 2
    _close(result, x, readings.size, variance)
    return result


@kernel
def own_log_likelihood(x: Floats, readings: Floats, owners: Ints, variance: float) -> Floats:
    """(N,) log p(readings[owners[j]] | state x[j]): every particle against its own node's reading.

    Raises IndexError for an unknown owner.
    """
    result = np.empty(x.size)
    for j in range(x.size):
        s = owners[j]
        if s < 0 or s >= readings.size:
            raise IndexError("a particle is owned by a reading that is not there")
        result[j] = (readings[s] - x[j] * x[j] / 20.0) ** 2
    _close(result, x, 1, variance)
    return result
