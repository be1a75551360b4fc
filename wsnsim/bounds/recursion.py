"""What is left of the doubt about a state, step by step, when every reading is used as well as can be.

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

Law: TypeAlias = tuple[Floats, Floats]
"""Of one step: the motion's slope F (R, D, D) at each truth, and the covariance Q (D, D) of the truth's noise."""

DIRECTIONS = 1e-9
"""Share of the largest eigenvalue of the scaled process noise below which there is no noise in a direction."""


def along_trajectories(laws: Iterable[Law], prior: Floats, told: Floats, place: list[int]) -> Floats:
    """(T, R, D, D) covariances of R recursions, each along its own truth.

    `laws`: of each step in turn; `prior` (R, D, D); `told`: information (T, R, P, P).
    """
    cov, result = prior, np.empty((len(told), *prior.shape))
    for step, (slope, noise) in enumerate(laws):
        result[step] = cov = updated(predicted(cov, slope, noise), told[step], place)
    return result


def over_trajectories(laws: Iterable[Law], prior: Floats, told: Floats, place: list[int]) -> Floats:
    """(T, D, D) covariances of one recursion, whose expectations are means over the R trajectories.

    Takes what `along_trajectories` does. Raises ValueError where the process noise is zero in a direction in which the
    slopes differ.
    """
    cov, result = prior.mean(axis=0), np.empty((len(told), *prior.shape[1:]))
    for step, (slope, noise) in enumerate(laws):
        known = updated(cov, _spread(slope, noise), list(range(len(cov))))
        result[step] = cov = updated(predicted(known, slope.mean(axis=0), noise), told[step].mean(axis=0), place)
    return result


def _spread(slope: Floats, noise: Floats) -> Floats:
    """(D, D) V: what the noise, by its smallness, tells of states whose slopes (R, D, D) differ."""
    apart = slope - slope.mean(axis=0)
    if not apart.any():
        return np.zeros_like(noise)
    inverse, lacking = inverse_noise(noise)
    if np.abs(lacking @ apart).max() > DIRECTIONS * np.abs(slope).max():
        raise ValueError("its noise is singular, in a direction in which its motion depends on its state")
    spread: Floats = (apart.swapaxes(-1, -2) @ inverse @ apart).mean(axis=0)
    return spread


def predicted(cov: Floats, slope: Floats, noise: Floats) -> Floats:
    """(..., D, D) P⁻ = F P Fᵀ + Q."""
    return slope @ cov @ slope.swapaxes(-1, -2) + noise


def updated(cov: Floats, told: Floats, place: list[int]) -> Floats:
    """(..., D, D) (P⁻¹ + I)⁻¹ of a P that may be singular, and information I (..., p, p) about the columns `place`.

    P - P_x (1 + I P_xx)⁻¹ I P_xᵀ with P_xx the block of these columns and P_x those columns. The eigenvalues of I P_xx,
    a product of two covariances, are not negative: what is inverted is never singular.
    """
    columns = cov[..., :, place]
    inner = np.eye(len(place)) + told @ columns[..., place, :]
    smaller = cov - columns @ np.linalg.solve(inner, told @ columns.swapaxes(-1, -2))
    result: Floats = 0.5 * (smaller + smaller.swapaxes(-1, -2))
    return result


def inverse_noise(noise: Floats) -> tuple[Floats, Floats]:
    """A generalised inverse of Q (D, D), and the projection on what Q does not reach, of columns scaled to one."""
    scale = np.sqrt(np.where(np.diag(noise) > 0.0, np.diag(noise), 1.0))
    values, vectors = np.linalg.eigh(noise / np.outer(scale, scale))
    lively = values > DIRECTIONS * max(float(values.max()), 0.0)
    some, none = vectors[:, lively], vectors[:, ~lively]
    inverse = (some / values[lively]) @ some.T / np.outer(scale, scale)
    return inverse, none @ none.T / scale
