"""Gaussians by hand: factors, fits, densities, draws and linearised updates of small matrices.

Shapes: points and means (D, N), covariances (N, D, D), lower Cholesky factors (D, D). D is small, the loops are plain.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wsnsim.kernels.elementary import log, normal_pair
from wsnsim.kernels.noise import INNER, SWITCHES

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Keys = NDArray[np.uint64]

TRIES = 14


@njit(**INNER)
def _factorise(matrix: Floats, jitter: float, result: Floats) -> bool:
    for i in range(matrix.shape[0]):
        for k in range(i + 1):
            value = matrix[i, k] + (jitter if i == k else 0.0)
            for d in range(k):
                value -= result[i, d] * result[k, d]
            if i > k:
                result[i, k] = value / result[k, k]
            elif not (0.0 < value < np.inf):
                return False
            else:
                result[i, i] = np.sqrt(value)
    return True


@njit(**SWITCHES)
def cholesky(matrix: Floats, result: Floats) -> None:
    """Write the lower Cholesky factor of a symmetric (D, D) matrix to `result`; upper triangles stay untouched.

    A jitter on the diagonal, relative to its mean, starts at nothing, then at 1e-14, and grows tenfold until the factor
    exists; a matrix beyond that (not finite, or far from definite) gives the identity scaled to that mean, or to one.
    """
    scale = 0.0
    for i in range(matrix.shape[0]):
        scale += abs(matrix[i, i]) / matrix.shape[0]
    if not (0.0 < scale < np.inf):
        scale = 1.0
    jitter = 0.0
    for _ in range(TRIES):
        if _factorise(matrix, jitter, result):
            return
        jitter = max(10.0 * jitter, 1e-14 * scale)
    for i in range(matrix.shape[0]):
        for k in range(i):
            result[i, k] = 0.0
        result[i, i] = np.sqrt(scale)


@njit(**SWITCHES)
def fit(cloud: Floats, offsets: Ints, ridge: float) -> tuple[Floats, Floats]:
    """Means (M, D) of a cloud's segments and the Cholesky factors (M, D, D) of their unweighted covariances.

    The covariances divide by n - 1 and get a ridge on the diagonal.
    """
    size, segments = cloud.shape[0], offsets.size - 1
    means, factors = np.empty((segments, size)), np.empty((segments, size, size))
    cov, around = np.empty((size, size)), np.empty(size)
    for m in range(segments):
        count = offsets[m + 1] - offsets[m]
        for d in range(size):
            means[m, d] = 0.0
            for e in range(size):
                factors[m, d, e] = cov[d, e] = 0.0
        for j in range(offsets[m], offsets[m + 1]):
            for d in range(size):
                means[m, d] += cloud[d, j] / count
        for j in range(offsets[m], offsets[m + 1]):
            for d in range(size):
                around[d] = cloud[d, j] - means[m, d]
                for e in range(d + 1):
                    cov[d, e] += around[d] * around[e] / max(count - 1, 1)
        for d in range(size):
            cov[d, d] += ridge
        cholesky(cov, factors[m])
    return means, factors


@njit(**SWITCHES)
def log_density(points: Floats, means: Floats, factors: Floats, offsets: Ints) -> Floats:
    """(N,) log density of each point (D, N) under its segment's Gaussian, up to its constant: -|L⁻¹(x - m)|² / 2."""
    result = np.empty(points.shape[1])
    white = np.empty(points.shape[0])
    for m in range(offsets.size - 1):
        for j in range(offsets[m], offsets[m + 1]):
            result[j] = 0.0
            for d in range(white.size):
                value = points[d, j] - means[m, d]
                for e in range(d):
                    value -= factors[m, d, e] * white[e]
                white[d] = value / factors[m, d, d]
                result[j] -= 0.5 * white[d] * white[d]
    return result


@njit(**SWITCHES)
def fuse(means: Floats, shares: Floats, within: Floats) -> tuple[Floats, Floats]:
    """The mean (D,) of means (M, D) by their shares (M,), and its covariance: their spread plus `within` (D, D)."""
    size, total = means.shape[1], 0.0
    mean = np.empty(size)
    for d in range(size):
        mean[d] = 0.0
    for m in range(shares.size):
        total += shares[m]
        for d in range(size):
            mean[d] += shares[m] * means[m, d]
    for d in range(size):
        mean[d] /= total
    cov = np.empty((size, size))
    for d in range(size):
        for e in range(d + 1):
            spread = 0.0
            for m in range(shares.size):
                spread += shares[m] * (means[m, d] - mean[d]) * (means[m, e] - mean[e])
            cov[d, e] = cov[e, d] = spread / total + 0.5 * (within[d, e] + within[e, d])
    return mean, cov


@njit(**SWITCHES)
def sample(means: Floats, covs: Floats, keys: Keys) -> tuple[Floats, Floats]:
    """Points (D, N), one a key, and their log densities (N,) up to (2π)^(-D/2): from Gaussian j, or from the only one.

    means (D, N), covs (N, D, D); or (D, 1), (1, D, D). Components 2p and 2p + 1 take the key's p-th pair of normals.
    """
    size = means.shape[0]
    points, logs = np.empty((size, keys.size)), np.zeros(keys.size)
    factor, white = np.zeros((size, size)), np.empty(size + 1)
    for j in range(keys.size):
        source = j if covs.shape[0] > 1 else 0
        if j == source:
            cholesky(covs[source], factor)
        for d in range(0, size, 2):
            white[d], white[d + 1] = normal_pair(keys[j], d // 2)
        volume = 1.0
        for d in range(size):
            volume *= factor[d, d]
            logs[j] -= 0.5 * white[d] * white[d]
            points[d, j] = means[d, source]
            for e in range(d + 1):
                points[d, j] += factor[d, e] * white[e]
        logs[j] -= log(volume)
    return points, logs


@njit(**SWITCHES)
def predict(covs: Floats, transitions: Floats, noise: Floats) -> Floats:
    """(N, D, D) covariances one step on: F P Fᵀ + Q, each with its own F (N, D, D). Symmetric by construction."""
    count, size = covs.shape[0], covs.shape[1]
    result, product = np.empty(covs.shape), np.empty((size, size))
    for j in range(count):
        for d in range(size):
            for e in range(size):
                product[d, e] = 0.0
                for k in range(size):
                    product[d, e] += transitions[j, d, k] * covs[j, k, e]
        for d in range(size):
            for e in range(d + 1):
                value = noise[d, e]
                for k in range(size):
                    value += product[d, k] * transitions[j, e, k]
                result[j, d, e] = result[j, e, d] = value
    return result


@njit(**SWITCHES)
def update(
    means: Floats,
    covs: Floats,
    expected: Floats,
    gradients: Floats,
    variances: Floats,
    readings: Floats,
    place: Ints,
) -> None:
    """Update means (D, N) and covariances (N, D, D) in place with S readings, linearised at the means as they come in.

    expected, variances (S, N), gradients (S, P, N) in the state's rows `place` (P,). Reading after reading with one
    fixed point of linearisation: the same as the extended Kalman filter's joint update, whose innovation covariance is
    S x S. A reading without a finite positive innovation variance is passed over.
    """
    size = means.shape[0]
    lift, start = np.empty(size), np.empty(place.size)
    for j in range(means.shape[1]):
        for p in range(place.size):
            start[p] = means[place[p], j]
        for s in range(readings.size):
            for d in range(size):
                lift[d] = 0.0
                for p in range(place.size):
                    lift[d] += covs[j, d, place[p]] * gradients[s, p, j]
            spread, surprise = variances[s, j], readings[s] - expected[s, j]
            for p in range(place.size):
                spread += gradients[s, p, j] * lift[place[p]]
                surprise -= gradients[s, p, j] * (means[place[p], j] - start[p])
            if not (0.0 < spread < np.inf):
                continue
            for d in range(size):
                means[d, j] += lift[d] * surprise / spread
                for e in range(size):
                    covs[j, d, e] -= lift[d] * lift[e] / spread
