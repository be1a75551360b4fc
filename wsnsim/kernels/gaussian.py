"""Gaussian distributions of few dimensions: Cholesky factors, fits, densities, samples and linearised updates.

Shapes: points and means (D, N), covariances (N, D, D), lower Cholesky factors (D, D). D is small, so that plain
loops are fast.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import dot, log, normal_pair, total
from wsnsim.kernels.particles import moments, relative_weights

TRIES = 14
"""Jitters that are tried, 0 included."""
LEAST_REST = 1e-9
"""If 1 - Σ w² is below this, one particle has all the weight, up to rounding errors."""


@inlined
def _factorise(matrix: Floats, jitter: float, result: Floats, size: int) -> bool:
    """Write the lower Cholesky factor of matrix + jitter I; return whether it exists.

    Inlined, so that loops are unrolled where `size` is a constant.
    """
    definite = True
    for i in range(size):
        for k in range(i + 1):
            value = matrix[i, k] + (jitter if i == k else 0.0)
            for d in range(k):
                value -= result[i, d] * result[k, d]
            if i > k:
                result[i, k] = value / result[k, k]
            else:
                definite = definite & (0.0 < value < np.inf)
                result[i, i] = np.sqrt(value)
    return definite


@kernel
def cholesky(matrix: Floats, result: Floats) -> None:
    """Write the lower Cholesky factor of a symmetric (D, D) matrix to `result`, whose upper triangle is not written.

    A jitter on the diagonal, relative to its mean, is first 0, then 1e-14, and grows tenfold until the factor exists.
    If it never does (not finite, or far from definite), the factor is that of the identity times the mean, or of the
    identity if the mean is not positive and finite.
    """
    scale = 0.0
    for i in range(matrix.shape[0]):
        scale += abs(matrix[i, i]) / matrix.shape[0]
    if not (0.0 < scale < np.inf):
        scale = 1.0
    jitter = 0.0
    for _ in range(TRIES):
        if _factorise(matrix, jitter, result, matrix.shape[0]):
            return
        jitter = max(10.0 * jitter, 1e-14 * scale)
    for i in range(matrix.shape[0]):
        for k in range(i):
            result[i, k] = 0.0
        result[i, i] = np.sqrt(scale)


@kernel
def fit(cloud: Floats, offsets: Ints, ridge: float) -> tuple[Floats, Floats]:
    """Means (M, D) of a cloud's segments and the Cholesky factors (M, D, D) of their unweighted covariances.

    The covariances divide by n - 1 and get a ridge on the diagonal.
    """
    size, segments = cloud.shape[0], offsets.size - 1
    means, factors = np.empty((segments, size)), np.empty((segments, size, size))
    cov, deviations = np.empty((size, size)), np.empty(cloud.shape)
    for m in range(segments):
        first, last = offsets[m], offsets[m + 1]
        for d in range(size):
            row, deviation = cloud[d, first:last], deviations[d, first:last]
            means[m, d] = mean = total(row) / max(row.size, 1)
            for j in range(row.size):
                deviation[j] = row[j] - mean
            for e in range(d + 1):
                cov[d, e] = dot(deviation, deviations[e, first:last]) / max(row.size - 1, 1)
                factors[m, e, d] = 0.0
            cov[d, d] += ridge
        cholesky(cov, factors[m])
    return means, factors


@kernel
def fit_weighted(cloud: Floats, log_weights: Floats, offsets: Ints, ridge: float) -> tuple[Floats, Floats]:
    """Means (M, D) and Cholesky factors as from `fit`, of segments whose particles have log-weights (N,).

    The covariances are divided by 1 - Σ w², with which equal weights give those of `fit`; by one if one particle has
    all the weight.
    """
    means, covs = moments(cloud, log_weights, offsets)
    weights, _ = relative_weights(log_weights, offsets)
    factors = np.zeros(covs.shape)
    for m in range(means.shape[0]):
        mine = weights[offsets[m] : offsets[m + 1]]
        whole = max(total(mine), 1.0)  # the largest relative weight is 1
        rest = 1.0 - dot(mine, mine) / (whole * whole)
        for d in range(covs.shape[1]):
            for e in range(covs.shape[1]):
                covs[m, d, e] /= rest if rest > LEAST_REST else 1.0
            covs[m, d, d] += ridge
        cholesky(covs[m], factors[m])
    return means, factors


@kernel
def log_density(points: Floats, means: Floats, factors: Floats, offsets: Ints) -> Floats:
    """Log density (N,) of each point (D, N) under its segment's Gaussian, without the constant: -|L⁻¹(x - m)|² / 2."""
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


@kernel
def fuse(means: Floats, shares: Floats, within: Floats) -> tuple[Floats, Floats]:
    """The mean (D,) of means (M, D) weighted by shares (M,), and the covariance: their spread plus `within` (D, D)."""
    size, whole = means.shape[1], 0.0
    mean = np.empty(size)
    for d in range(size):
        mean[d] = 0.0
    for m in range(shares.size):
        whole += shares[m]
        for d in range(size):
            mean[d] += shares[m] * means[m, d]
    for d in range(size):
        mean[d] /= whole
    cov = np.empty((size, size))
    for d in range(size):
        for e in range(d + 1):
            spread = 0.0
            for m in range(shares.size):
                spread += shares[m] * (means[m, d] - mean[d]) * (means[m, e] - mean[e])
            cov[d, e] = cov[e, d] = spread / whole + 0.5 * (within[d, e] + within[e, d])
    return mean, cov


@kernel
def sample(means: Floats, covs: Floats, keys: Keys) -> tuple[Floats, Floats]:
    """Samples (D, N), one per key, and their log densities (N,) without the constant: from Gaussian j, or the only one.

    means (D, N), covs (N, D, D); or (D, 1), (1, D, D). Components 2p and 2p + 1 take the key's p-th pair of normals.
    """
    size, count = means.shape[0], keys.size
    points, logs = np.empty((size, count)), np.empty(count)
    white, factor = np.empty((size + 1, count)), np.empty((size, size))
    for d in range(0, size, 2):
        first, second = white[d], white[d + 1]
        for j in range(count):
            first[j], second[j] = normal_pair(keys[j], d // 2)
    for j in range(count):
        source = j if covs.shape[0] > 1 else 0
        # a common Gaussian is factorised once; four columns, the usual case, without a jitter first
        if j == source and not (size == 4 and _factorise(covs[source], 0.0, factor, size)):
            cholesky(covs[source], factor)
        volume = 1.0
        for d in range(size):
            volume *= factor[d, d]
            value = means[d, source]
            for e in range(d + 1):
                value += factor[d, e] * white[e, j]
            points[d, j] = value
        logs[j] = volume  # its logarithm is taken in the loop below, which vectorises
    for j in range(count):
        square = 0.0
        for d in range(size):
            square += white[d, j] * white[d, j]
        logs[j] = -0.5 * square - log(logs[j])
    return points, logs


@inlined
def _set_predicted(
    result: Floats, covs: Floats, transitions: Floats, noise: Floats, product: Floats, size: int
) -> None:
    """Write F P Fᵀ + Q of every particle. Inlined, so that loops are unrolled where `size` is a constant."""
    for j in range(covs.shape[0]):
        cov, transition, target = covs[j], transitions[j], result[j]
        for d in range(size):
            for e in range(size):
                value = 0.0
                for k in range(size):
                    value += transition[d, k] * cov[k, e]
                product[d, e] = value
        for d in range(size):
            for e in range(d + 1):
                value = noise[d, e]
                for k in range(size):
                    value += product[d, k] * transition[e, k]
                target[d, e] = target[e, d] = value


@kernel
def predict(covs: Floats, transitions: Floats, noise: Floats) -> Floats:
    """The covariances (N, D, D) one step later: F P Fᵀ + Q, each with its own F (N, D, D). Exactly symmetric."""
    result, product = np.empty(covs.shape), np.empty(noise.shape)
    if covs.shape[1] == 4:
        _set_predicted(result, covs, transitions, noise, product, 4)
    else:
        _set_predicted(result, covs, transitions, noise, product, covs.shape[1])
    return result


@kernel
def update(
    means: Floats,
    covs: Floats,
    expected: Floats,
    gradients: Floats,
    variances: Floats,
    readings: Floats,
    columns: Ints,
) -> None:
    """Update means (D, N) and covariances (N, D, D) in place with S readings, linearised at the given means.

    expected, variances (S, N), gradients (S, P, N) in the state's `columns` (P,). The readings are processed in turn,
    all linearised at the same point: this equals the extended Kalman filter's joint update, whose innovation covariance
    is S x S. A reading without a finite positive innovation variance is skipped.
    """
    size, count = means.shape
    cross, start = np.empty(size), np.empty((columns.size, count))
    for p in range(columns.size):
        for j in range(count):
            start[p, j] = means[columns[p], j]
    for s in range(readings.size):
        for j in range(count):
            cov, variance, innovation = covs[j], variances[s, j], readings[s] - expected[s, j]
            for d in range(size):
                value = 0.0
                for p in range(columns.size):
                    value += cov[d, columns[p]] * gradients[s, p, j]
                cross[d] = value
            for p in range(columns.size):
                variance += gradients[s, p, j] * cross[columns[p]]
                innovation -= gradients[s, p, j] * (means[columns[p], j] - start[p, j])
            if not (0.0 < variance < np.inf):
                continue
            inverse = 1.0 / variance
            for d in range(size):
                gain = cross[d] * inverse
                means[d, j] += gain * innovation
                for e in range(size):
                    cov[d, e] -= gain * cross[e]
