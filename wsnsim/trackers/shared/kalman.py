"""What Kalman filters in a head have in common: a Gaussian belief with the innovation of its update, and operations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import NO_INNOVATION, Estimate, Innovation
from wsnsim.trackers.shared.heads import GaussianBelief

LINEARISE_CYCLES = 20.0
"""CPU cycles to compute what is expected of one reading at one point, with its slope and variance."""


@dataclass(frozen=True, slots=True)
class KalmanBelief(GaussianBelief):
    """A Gaussian after a step of a Kalman filter. It has all that a `GaussianBelief` has.

    Attributes:
        innovation: that of the step's update.
    """

    innovation: Innovation = NO_INNOVATION


def kalman_estimate(belief: GaussianBelief) -> Estimate:
    """The belief's mean and covariance, with the innovation of the step; after a handover there is none yet.

    Args:
        belief: A `KalmanBelief`, or a `GaussianBelief` that has arrived from another head.
    """
    innovation = belief.innovation if isinstance(belief, KalmanBelief) else NO_INNOVATION
    return Estimate(belief.mean, belief.cov, innovation=innovation)


def prediction_cycles(size: int) -> float:
    """Operations of one step x⁻ = f(x), P⁻ = F P Fᵀ + Q of a state of so many columns."""
    return 4.0 * size**3 + 2.0 * size**2


def update_cycles(size: int, place: int) -> float:
    """Operations by which one linearised reading updates a state of `size` columns, `place` of them the position."""
    innovation = 4.0 * place + 2.0 * place * size + LINEARISE_CYCLES  # ν, S = H P⁻ Hᵀ + R
    update = 3.0 * size + 8.0 * size**2  # x⁺ = x⁻ + G ν; P⁺ in Joseph's form
    return innovation + update


def is_definite(cov: Floats) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        return False
    return True
