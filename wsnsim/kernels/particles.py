"""What every particle filter does with log-weights, for the clouds of many nodes laid end to end.

`offsets` (M + 1,) cuts the N columns into M segments, one a node; a segment may be empty. Log-weights are relative to
equal weights: a segment is normalised when its *mean* weight is one, so a particle may change node and keep its number.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wsnsim.kernels.elementary import exp, log
from wsnsim.kernels.noise import INNER, SWITCHES

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NOTHING = -690.0


@njit(**INNER)
def relative_weights(log_weights: Floats, offsets: Ints) -> tuple[Floats, Floats]:
    """Weights (N,) relative to the largest of their segment, and the log of that one (M,); NaN counts as no weight.

    A segment in which nothing is likely, or something infinitely so, gets ones, and -inf.
    """
    weights, tops = np.empty(log_weights.size), np.empty(offsets.size - 1)
    for m in range(offsets.size - 1):
        top = -np.inf
        for j in range(offsets[m], offsets[m + 1]):
            top = log_weights[j] if log_weights[j] > top else top
        known = -np.inf < top < np.inf
        tops[m] = top if known else -np.inf
        for j in range(offsets[m], offsets[m + 1]):
            below = log_weights[j] - top if known else 0.0
            weights[j] = exp(below) if below > NOTHING else 0.0
    return weights, tops


@njit(**SWITCHES)
def weigh(log_weights: Floats, offsets: Ints) -> Floats:
    """(M,) effective numbers (sum w)² / sum w² of the segments, whose log-weights are normalised in place.

    They get the mean weight one. A segment in which nothing is likely gets equal weights and the effective number 0.
    Jiang (2013), eq. (14).
    """
    effective = np.empty(offsets.size - 1)
    weights, tops = relative_weights(log_weights, offsets)
    for m in range(offsets.size - 1):
        total, squares = 0.0, 0.0
        for j in range(offsets[m], offsets[m + 1]):
            total += weights[j]
            squares += weights[j] * weights[j]
        known = tops[m] > -np.inf
        shift = tops[m] + log(total / (offsets[m + 1] - offsets[m])) if known else 0.0
        for j in range(offsets[m], offsets[m + 1]):
            if weights[j] > 0.0:
                log_weights[j] = log_weights[j] - shift if known else 0.0
            else:
                log_weights[j] = -np.inf
        effective[m] = total * total / squares if known else 0.0
    return effective


@njit(**SWITCHES)
def moments(cloud: Floats, log_weights: Floats, offsets: Ints) -> tuple[Floats, Floats]:
    """Weighted means (M, D) and covariances (M, D, D) of the segments of a cloud (D, N).

    Zeros for an empty segment. A particle without weight does not count, finite or not.
    """
    size, segments = cloud.shape[0], offsets.size - 1
    means, covs = np.empty((segments, size)), np.empty((segments, size, size))
    weights, _ = relative_weights(log_weights, offsets)
    around = np.empty(size)
    for m in range(segments):
        total = 0.0
        for d in range(size):
            means[m, d] = 0.0
            for e in range(size):
                covs[m, d, e] = 0.0
        for j in range(offsets[m], offsets[m + 1]):
            total += weights[j]
            if weights[j] == 0.0:
                continue
            for d in range(size):
                means[m, d] += weights[j] * cloud[d, j]
        for d in range(size):
            means[m, d] /= max(total, 1.0)
        for j in range(offsets[m], offsets[m + 1]):
            share = weights[j] / total
            if share == 0.0:
                continue
            for d in range(size):
                around[d] = cloud[d, j] - means[m, d]
                for e in range(d + 1):
                    covs[m, d, e] += share * around[d] * around[e]
        for d in range(size):
            for e in range(d):
                covs[m, e, d] = covs[m, d, e]
    return means, covs


@njit(**SWITCHES)
def systematic(log_weights: Floats, offsets: Ints, sizes: Ints, starts: Floats) -> Ints:
    """(sum of sizes,) columns drawn by systematic resampling: sizes[m] from segment m, first tooth at starts[m] < 1.

    A column of normalised weight w is drawn floor(size w) or ceil(size w) times, size w times on average; one of weight
    zero never. A segment in which nothing is likely is drawn from evenly.
    """
    wanted = 0
    for m in range(sizes.size):
        wanted += sizes[m]
    chosen = np.empty(wanted, np.int64)
    weights, _ = relative_weights(log_weights, offsets)
    drawn = 0
    for m in range(sizes.size):
        total, final = 0.0, offsets[m]
        for j in range(offsets[m], offsets[m + 1]):
            total += weights[j]
            if weights[j] > 0.0:
                final = j
        column, reached = offsets[m], 0.0
        for i in range(sizes[m]):
            tooth = (i + starts[m]) * total / sizes[m]
            while reached + weights[column] <= tooth and column < final:
                reached += weights[column]
                column += 1
            chosen[drawn] = column
            drawn += 1
    return chosen
