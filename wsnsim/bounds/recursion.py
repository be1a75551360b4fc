"""Recursions for the least error covariance of a state, step by step.

    P⁻ = Q + F P Fᵀ        P = (P⁻⁻¹ + I)⁻¹                                            along one trajectory
    P⁻ = Q + F̄ (P⁻¹ + V)⁻¹ F̄ᵀ,  V = E[(F - F̄)ᵀ Q⁻¹ (F - F̄)],  I = E[information]      over all trajectories

The second is the recursion of Tichavský, Muravchik, Nehorai (1998), eq. 21: with their D11 = E[Fᵀ Q⁻¹ F] and
D12 = -E[F]ᵀ Q⁻¹, the matrix inversion lemma takes J = D22 - D12ᵀ (J + D11)⁻¹ D12 to this form, in which neither the
process noise Q nor the information has to be inverted: both may be singular.

Shapes: R trajectories, T steps, D state columns, P of them (`place`) the position. Information is (..., P, P).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats

LinearisedMotion: TypeAlias = tuple[Floats, Floats]
"""The motion model at one step: the Jacobian F (R, D, D) at each truth, and the covariance Q (D, D) of its noise."""

NO_NOISE = 1e-9
"""Eigenvalues of the scaled process noise below this share of the largest count as zero."""


def along_trajectories(
    motions: Iterable[LinearisedMotion], prior: Floats, information: Floats, place: list[int]
) -> Floats:
    """The covariances of R recursions, each along its own trajectory, (T, R, D, D).

    Args:
        motions: the linearised motion model of each step.
        prior: (R, D, D) covariances at step 0.
        information: (T, R, P, P) Fisher information of the readings.
        place: the state columns of the position.
    """
    cov, result = prior, np.empty((len(information), *prior.shape))
    for step, (jacobian, noise) in enumerate(motions):
        result[step] = cov = updated(predicted(cov, jacobian, noise), information[step], place)
    return result


def over_trajectories(
    motions: Iterable[LinearisedMotion], prior: Floats, information: Floats, place: list[int]
) -> Floats:
    """The covariances of one recursion whose expectations are means over R trajectories, (T, D, D).

    Args: as `along_trajectories`.

    Raises:
        ValueError: the process noise is zero in a direction in which the Jacobians differ.
    """
    cov, result = prior.mean(axis=0), np.empty((len(information), *prior.shape[1:]))
    for step, (jacobian, noise) in enumerate(motions):
        known = updated(cov, _information_of_spread(jacobian, noise), list(range(len(cov))))
        result[step] = cov = updated(
            predicted(known, jacobian.mean(axis=0), noise), information[step].mean(axis=0), place
        )
    return result


def _information_of_spread(jacobian: Floats, noise: Floats) -> Floats:
    """V (D, D): the information about the state that Jacobians (R, D, D) carry because they differ between states."""
    deviation = jacobian - jacobian.mean(axis=0)
    if not deviation.any():
        return np.zeros_like(noise)
    inverse, null_space = inverse_noise(noise)
    if np.abs(null_space @ deviation).max() > NO_NOISE * np.abs(jacobian).max():
        raise ValueError("the process noise is singular in a direction in which the motion depends on the state")
    spread: Floats = (deviation.swapaxes(-1, -2) @ inverse @ deviation).mean(axis=0)
    return spread


def predicted(cov: Floats, jacobian: Floats, noise: Floats) -> Floats:
    """P⁻ = F P Fᵀ + Q, (..., D, D)."""
    return jacobian @ cov @ jacobian.swapaxes(-1, -2) + noise


def updated(cov: Floats, information: Floats, place: list[int]) -> Floats:
    """(P⁻¹ + I)⁻¹, (..., D, D), of a P that may be singular and information I (..., p, p) on the columns `place`.

    Computed as P - P_x (1 + I P_xx)⁻¹ I P_xᵀ with P_xx the block of these columns and P_x those columns. The
    eigenvalues of I P_xx, a product of two covariances, are not negative, so the inverted matrix is never singular.
    """
    columns = cov[..., :, place]
    inner = np.eye(len(place)) + information @ columns[..., place, :]
    smaller = cov - columns @ np.linalg.solve(inner, information @ columns.swapaxes(-1, -2))
    result: Floats = 0.5 * (smaller + smaller.swapaxes(-1, -2))
    return result


def inverse_noise(noise: Floats) -> tuple[Floats, Floats]:
    """A generalised inverse of Q (D, D), and the projection on its null space with the columns scaled to one."""
    scale = np.sqrt(np.where(np.diag(noise) > 0.0, np.diag(noise), 1.0))
    values, vectors = np.linalg.eigh(noise / np.outer(scale, scale))
    positive = values > NO_NOISE * max(float(values.max()), 0.0)
    range_, null_space = vectors[:, positive], vectors[:, ~positive]
    inverse = (range_ / values[positive]) @ range_.T / np.outer(scale, scale)
    return inverse, null_space @ null_space.T / scale
