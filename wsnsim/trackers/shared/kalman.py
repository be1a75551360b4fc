"""What Kalman filters in a head have in common: operations, and updates of many filters at once.

Updates with the same measurement of means (K, 4) and covariances (K, 4, 4) return the means, the covariances and the
log-likelihoods (K,). Where a measurement is so much sharper than the prediction, or than another axis of its own, that
a difference of covariances would keep none of their digits, Joseph's form takes its place (Bucy, Joseph 1968): a sum of
squares of roots, one axis of the measurement after the other.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Scene
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence

LINEARISE_CYCLES = 20.0
"""CPU cycles to compute what is expected of one reading at one point, with its slope and variance."""


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


Updates: TypeAlias = tuple[Floats, Floats, Floats]
PLACE: Final = np.array([0, 2])
"""The columns of the position."""
SHARP: Final = 1e-14
"""A variance below this share of another is lost beside it: a number has 16 digits."""
ROUNDING: Final = float(np.finfo(np.float64).eps)


def updated_by_fix(means: Floats, covs: Floats, point: Floats, noise: Floats) -> Updates:
    """After a fix (2,) of covariance (2, 2)."""
    values, axes = np.linalg.eigh(noise)
    if values[0] < SHARP * max(values[1], covs.max()):
        return _updated_by_axes(means, covs, point, np.maximum(values, ROUNDING * values[1]), axes)
    innovation = point - means[:, PLACE]
    spread = covs[:, PLACE][:, :, PLACE] + noise
    inverse = np.linalg.inv(spread)
    gain = covs[:, :, PLACE] @ inverse
    later = means + np.einsum("kij,kj->ki", gain, innovation)
    cov = covs - gain @ covs[:, PLACE, :]
    square = np.einsum("ki,kij,kj->k", innovation, inverse, innovation)
    return later, symmetric(cov), -0.5 * (square + np.log(np.linalg.det(spread)))


def updated_by_readings(means: Floats, covs: Floats, seen: Evidence, scene: Scene) -> Updates:
    """After one reading at a time, linearised."""
    scores = np.zeros(len(means))
    for i, reading in enumerate(seen.readings.tolist()):
        points = np.ascontiguousarray(means[:, PLACE].T)
        expected, gradients, variances = scene.sensor.linearise(
            points, seen.positions[i : i + 1], seen.traits[i : i + 1]
        )
        g = gradients[0].T
        cross = np.einsum("kij,kj->ki", covs[:, :, PLACE], g)
        told = np.einsum("ki,ki->k", g, cross[:, PLACE])
        innovation = reading - expected[0]
        if (variances[0] < SHARP * told).any():
            means, roots, more = _updated_along(means, _roots(covs), innovation, g, variances[0])
            covs, scores = roots @ roots.transpose(0, 2, 1), scores + more
            continue
        spread = told + variances[0]
        means = means + cross * (innovation / spread)[:, None]
        covs = covs - cross[:, :, None] * cross[:, None, :] / spread[:, None, None]
        scores = scores - 0.5 * (innovation**2 / spread + np.log(spread))
    return means, symmetric(covs), scores


def _updated_by_axes(means: Floats, covs: Floats, point: Floats, variances: Floats, axes: Floats) -> Updates:
    """After a fix (2,) with independent errors of variances (2,) along axes, the columns of (2, 2)."""
    roots, scores = _roots(covs), np.zeros(len(means))
    for variance, axis in zip(variances.tolist(), axes.T, strict=True):
        innovation = (point - means[:, PLACE]) @ axis
        slopes, each = np.broadcast_to(axis, (len(means), 2)), np.full(len(means), variance)
        means, roots, more = _updated_along(means, roots, innovation, slopes, each)
        scores = scores + more
    return means, roots @ roots.transpose(0, 2, 1), scores


def _roots(covs: Floats) -> Floats:
    """(K, 4, 4) R of each covariance R Rᵀ; what rounding has made negative is 0."""
    values, axes = np.linalg.eigh(covs)
    roots: Floats = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return roots


def _updated_along(means: Floats, roots: Floats, innovation: Floats, slopes: Floats, variances: Floats) -> Updates:
    """After one number, its innovations (K,), its slopes (K, 2) by the position, and its variances (K,).

    Takes and returns roots R (K, 4, n) of covariances R Rᵀ, those returned with another column.
    """
    seen = np.einsum("kin,ki->kn", roots[:, PLACE], slopes)
    spread = (seen * seen).sum(axis=1) + variances
    gain = np.einsum("kin,kn->ki", roots, seen) / spread[:, None]
    left = roots - gain[:, :, None] * seen[:, None, :]
    noise = gain * np.sqrt(variances)[:, None]
    later = means + gain * innovation[:, None]
    return later, np.concatenate([left, noise[:, :, None]], axis=2), -0.5 * (innovation**2 / spread + np.log(spread))
