"""The models of Jiang, Song, Lin (2013) for many states at once: motion of bounded velocity, energy of a sound.

Motion (eqs. 1-4):

drift = (T, a, c1, c2)               the constants of A: step, bound, and the factors of the pull
root = (l11, l21, l22)               the lower Cholesky factor of one axis' process covariance
states (4, N): rows px, vx, py, vy; the axes move independently of each other

The energy at a sensor (eqs. 5-8):

    law = (σ², I, α, 2c/N_sam, inflation)         the sensor's constants, a tuple of five floats
    signal s = I d^-α, with d at least 1 m        mean μ = σ² + g s, variance R = (2c/N_sam) μ² + inflation s²

Points are given by their coordinates x (N,) and y (N,); positions are (S, 2), gains (S,). The log-likelihood is -inf
for a point that is not finite and for a reading that is NaN; it is never NaN.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, inner, kernel
from wsnsim.kernels.elementary import LOG_TWO_PI, close, exp2, log, log2, normal_pair

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


Law: TypeAlias = tuple[float, float, float, float, float]


@inner
def _set_signals(
    signals: Floats, x: Floats, y: Floats, x_sensor: float, y_sensor: float, intensity: float, decay: float
) -> None:
    """Write I d^-α, with d at least 1 m, as I exp2(-α/2 log2 d²). Two short loops overlap better than a long one."""
    for j in range(x.size):
        squared = (x[j] - x_sensor) ** 2 + (y[j] - y_sensor) ** 2
        signals[j] = -0.5 * decay * log2(squared if squared > 1.0 else 1.0)
    for j in range(x.size):
        signals[j] = intensity * exp2(signals[j])


@kernel
def own_log_likelihood(
    x: Floats, y: Floats, readings: Floats, positions: Floats, gains: Floats, owners: Ints, law: Law
) -> Floats:
    """(N,) log p(readings[owners[j]] | target at point j): every particle against its own node's reading.

    What belongs to the owners is collected first, so that the second loop vectorises. Raises IndexError for an
    unknown owner.
    """
    noise, intensity, decay, spread, inflation = law
    across, up, gain, reading = np.empty(x.size), np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for j in range(x.size):
        s = owners[j]
        if s < 0 or s >= readings.size:
            raise IndexError("a particle is owned by a reading that is not there")
        across[j], up[j] = x[j] - positions[s, 0], y[j] - positions[s, 1]
        gain[j], reading[j] = gains[s], readings[s]
    result = np.empty(x.size)
    _set_signals(result, across, up, 0.0, 0.0, intensity, decay)
    for j in range(x.size):
        signal = result[j]
        mean = noise + gain[j] * signal
        variance = spread * mean * mean + inflation * signal * signal
        result[j] = (reading[j] - mean) ** 2 / variance + log(variance)
    close(result, x, y, LOG_TWO_PI, 1.0)
    return result


@kernel
def joint_log_likelihood(x: Floats, y: Floats, readings: Floats, positions: Floats, gains: Floats, law: Law) -> Floats:
    """(N,) log p(all S readings | target at point j). The logarithm is taken once for the product of four variances."""
    noise, intensity, decay, spread, inflation = law
    result, product, signals = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    for j in range(x.size):
        result[j], product[j] = 0.0, 1.0
    for s in range(readings.size):
        reading, gain = readings[s], gains[s]
        _set_signals(signals, x, y, positions[s, 0], positions[s, 1], intensity, decay)
        for j in range(x.size):
            mean = noise + gain * signals[j]
            variance = spread * mean * mean + inflation * signals[j] * signals[j]
            result[j] += (reading - mean) ** 2 / variance
            product[j] *= variance
        if s % 4 == 3 or s == readings.size - 1:
            for j in range(x.size):
                result[j] += log(product[j])
                product[j] = 1.0
    close(result, x, y, readings.size * LOG_TWO_PI, 1.0)
    return result


@kernel
def linearised(x: Floats, y: Floats, positions: Floats, gains: Floats, law: Law) -> tuple[Floats, Floats, Floats]:
    """Expected readings (S, N), their gradients in x and y (S, 2, N), their variances (S, N).

    ∂μ/∂x = -α g s (x - x_s) / d², and 0 below 1 m. A point that is not finite counts as infinitely far.
    """
    noise, intensity, decay, spread, inflation = law
    means = np.empty((gains.size, x.size))
    gradients = np.empty((gains.size, 2, x.size))
    variances = np.empty((gains.size, x.size))
    signals = np.empty(x.size)
    for s in range(gains.size):
        x_sensor, y_sensor, gain = positions[s, 0], positions[s, 1], gains[s]
        _set_signals(signals, x, y, x_sensor, y_sensor, intensity, decay)
        for j in range(x.size):
            across, up = x[j] - x_sensor, y[j] - y_sensor
            squared = across * across + up * up
            known = squared < np.inf
            signal = signals[j] if known else 0.0
            slope = -decay * gain * signal / squared if (squared > 1.0) & known else 0.0
            mean = noise + gain * signal
            means[s, j] = mean
            gradients[s, 0, j] = slope * across if known else 0.0
            gradients[s, 1, j] = slope * up if known else 0.0
            variances[s, j] = spread * mean * mean + inflation * signal * signal
    return means, gradients, variances
