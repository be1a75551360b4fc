"""Updates of many Gaussians with detections whose origin is uncertain.

means (N, A), covs (N, A, A): the joint moments of the state and of what sensors are expected to read, with their noise
detections (M, d): rows of one sensor, whose readings are the columns `first` to `first + d` of the joint moments
periods (d,): of angles, 0 for a component that has none

Since the moments are joint, a detection of one sensor updates the state and what is expected of the other sensors. All
sensors in turn give the joint update of a Kalman filter whose readings are linearised at one prediction.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.kernels.compilation import inner, kernel
from wsnsim.kernels.elementary import LOG_TWO_PI
from wsnsim.kernels.gaussian import cholesky


@inner
def _factor(cov: Floats, first: int, size: int) -> Floats:
    """The lower Cholesky factor of the covariance of an innovation."""
    width, factor = np.empty((size, size)), np.zeros((size, size))
    for p in range(size):
        for q in range(size):
            width[p, q] = cov[first + p, first + q]
    cholesky(width, factor)
    return factor


@inner
def _innovation(detection: Floats, mean: Floats, first: int, periods: Floats, result: Floats) -> None:
    """Write the shortest difference (d,) of a detection from what is expected."""
    for p in range(periods.size):
        apart = detection[p] - mean[first + p]
        result[p] = apart - periods[p] * np.round(apart / periods[p]) if periods[p] > 0.0 else apart


@kernel
def score(means: Floats, covs: Floats, first: int, detections: Floats, periods: Floats) -> tuple[Floats, Floats]:
    """Log densities (N, M) of detections, log N(ν; 0, S), and their squared distances νᵀ S⁻¹ ν (N, M)."""
    size = periods.size
    logs, squares = np.empty((means.shape[0], detections.shape[0])), np.empty((means.shape[0], detections.shape[0]))
    apart = np.empty(size)
    for n in range(means.shape[0]):
        factor, constant = _factor(covs[n], first, size), 0.5 * size * LOG_TWO_PI
        for p in range(size):
            constant += np.log(factor[p, p])
        for j in range(detections.shape[0]):
            _innovation(detections[j], means[n], first, periods, apart)
            square = 0.0
            for p in range(size):
                for q in range(p):
                    apart[p] -= factor[p, q] * apart[q]
                apart[p] /= factor[p, p]
                square += apart[p] * apart[p]
            squares[n, j], logs[n, j] = square, -0.5 * square - constant
    return logs, squares


@inner
def _gain(cov: Floats, factor: Floats, first: int, result: Floats) -> None:
    """Write the gain G = C S⁻¹ (A, d) of an innovation with the covariance S = L Lᵀ."""
    for d in range(result.shape[0]):
        row = result[d]
        for p in range(row.size):
            row[p] = cov[d, first + p]
            for q in range(p):
                row[p] -= factor[p, q] * row[q]
            row[p] /= factor[p, p]
        for p in range(row.size - 1, -1, -1):
            for q in range(p + 1, row.size):
                row[p] -= factor[q, p] * row[q]
            row[p] /= factor[p, p]


@inner
def _add_spread(mean: Floats, cov: Floats, gain: Floats, shift: Floats, spread: Floats) -> None:
    """Add G s to the mean (A,), and G B Gᵀ to the covariance, in place; B is the spread (d, d)."""
    for d in range(mean.size):
        for p in range(shift.size):
            mean[d] += gain[d, p] * shift[p]
            rest = 0.0
            for q in range(shift.size):
                rest += gain[d, q] * spread[q, p]
            for e in range(d + 1):
                cov[d, e] += rest * gain[e, p]
        for e in range(d):
            cov[e, d] = cov[d, e]


@kernel
def condition(
    means: Floats, covs: Floats, first: int, detections: Floats, periods: Floats, probabilities: Floats
) -> None:
    """Update joint moments in place with detections that are a Gaussian's own with some probabilities (N, M).

    The moments become those of the mixture over the origins: x + G Σ β ν and P + G (V - β̄ S) Gᵀ, where β̄ is the sum of
    the probabilities β, V = Σ β ν νᵀ - (Σ β ν) (Σ β ν)ᵀ, S the covariance of the innovations and G the gain.
    Bar-Shalom, Li (1995).
    """
    size = periods.size
    apart, gain = np.empty(size), np.empty((means.shape[1], size))
    for n in range(means.shape[0]):
        total, shift, spread = 0.0, np.zeros(size), np.zeros((size, size))
        for j in range(detections.shape[0]):
            share = probabilities[n, j]
            if share > 0.0:
                total += share
                _innovation(detections[j], means[n], first, periods, apart)
                for p in range(size):
                    shift[p] += share * apart[p]
                    for q in range(size):
                        spread[p, q] += share * apart[p] * apart[q]
        if total > 0.0:
            for p in range(size):
                for q in range(size):
                    spread[p, q] -= shift[p] * shift[q] + total * covs[n, first + p, first + q]
            _gain(covs[n], _factor(covs[n], first, size), first, gain)
            _add_spread(means[n], covs[n], gain, shift, spread)
