"""Linear Gaussian transitions of one step: x⁺ = F x + L w with standard normal w.

accelerating(q, dt), coasting(noise_input, variances, dt), near_constant_velocity(q, dt), mean_reverting(memory, sd, dt)
"""

from __future__ import annotations

import functools
import math
from typing import Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats

NoiseInput = Literal["accelerations", "diagonal", "direct"]


class LinearProcess(NamedTuple):
    """One step of a linear motion: F (D, D), a root L (D, K) of the process covariance Q, and Q = L Lᵀ (D, D)."""

    transition: Floats
    root: Floats
    covariance: Floats

    def matrices(self, count: int) -> tuple[Floats, Floats]:
        """F (count, D, D), one read-only matrix repeated, and a copy of Q (D, D)."""
        if count != 1:
            return np.broadcast_to(self.transition, (count, *self.transition.shape)), self.covariance.copy()
        once = self.transition[None]  # a tenth of the time
        once.flags.writeable = False
        return once, self.covariance.copy()


@functools.lru_cache(maxsize=64)
def accelerating(q: float, dt: float) -> LinearProcess:
    """F and G of Liu, Wang (2012), eqs. 16-17."""
    transition = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    root = np.sqrt(q) * np.array([[dt**2 / 2], [dt], [1.0]])
    return LinearProcess(transition, root, root @ root.T)


@functools.lru_cache(maxsize=64)
def coasting(noise_input: NoiseInput, variances: tuple[float, ...], dt: float) -> LinearProcess:
    """F and Γ of Wei, Guo (2022), experiment 3, or of Ruan et al. (2020), eq. 3."""
    transition = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    lever = np.array([[dt**2 / 2], [dt]])
    gammas = {
        "accelerations": np.kron(np.eye(2), lever),
        "diagonal": np.diag(np.tile(lever[:, 0], 2)),
        "direct": np.eye(4),
    }
    root = gammas[noise_input] * np.sqrt(variances)
    return LinearProcess(transition, root, root @ root.T)


@functools.lru_cache(maxsize=64)
def near_constant_velocity(q: float, dt: float) -> LinearProcess:
    """White noise of intensity q in the acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-7)."""
    transition = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    root: Floats = math.sqrt(q) * np.array(
        [[math.sqrt(dt**3 / 3.0), 0.0], [math.sqrt(3.0 * dt) / 2.0, math.sqrt(dt) / 2.0]]
    )
    both_axes: Floats = np.kron(np.eye(2), root).astype(np.float64)
    return LinearProcess(transition, both_axes, both_axes @ both_axes.T)


@functools.lru_cache(maxsize=64)
def mean_reverting(memory: float, sd: float, dt: float) -> LinearProcess:
    """An Ornstein-Uhlenbeck velocity and its integral over dt (Uhlenbeck, Ornstein 1930), independent on each axis.

    The terms of the position's variance cancel to third order in dt/τ: below 1e-3 its series is used.
    """
    r = dt / memory
    alpha, gone = math.exp(-r), -math.expm1(-r)
    position = r**3 * (2.0 / 3.0 - r / 2.0) if r < 1e-3 else 2.0 * r - 3.0 + 4.0 * alpha - alpha * alpha
    a, b, c = sd**2 * memory**2 * position, sd**2 * memory * gone**2, -(sd**2) * math.expm1(-2.0 * r)
    first = math.sqrt(a)
    lower = b / first if first > 0.0 else 0.0
    axis = np.array([[first, 0.0], [lower, math.sqrt(max(c - lower * lower, 0.0))]])
    root = np.kron(np.eye(2), axis)
    transition = np.kron(np.eye(2), np.array([[1.0, memory * gone], [0.0, alpha]]))
    return LinearProcess(transition, root, root @ root.T)
