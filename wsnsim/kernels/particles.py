"""Weights, moments and resampling of particle filters, for the concatenated clouds of many nodes.

`offsets` (M + 1,) divides the N columns into M segments, one per node; a segment may be empty. Log-weights are relative
to equal weights: a segment is normalised if its *mean* weight is one, so that a particle keeps its weight at another
node.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.kernels.compilation import inner, kernel
from wsnsim.kernels.elementary import dot, exp, log, total


def allocate(total: int, active: int) -> Ints:
    """(active,) numbers of particles of the active members; empty without members. Jiang (2013), eq. (25).

    Each member gets what is left divided by the members still to be served, rounded down: floor(total / active), and
    one more for the last (total mod active). Plain NumPy, since it is called rarely.
    """
    shares = np.full(active, total // max(active, 1), np.int64)
    shares[active - total % max(active, 1) :] += 1
    return shares


NOTHING = -690.0


@inner
def relative_weights(log_weights: Floats, offsets: Ints) -> tuple[Floats, Floats]:
    """Weights (N,) relative to the largest of their segment, and the log of that one (M,); NaN counts as no weight.

    A segment without positive weights, or with an infinite one, gets ones, and -inf.
    """
    weights, tops = np.empty(log_weights.size), np.empty(offsets.size - 1)
    for m in range(offsets.size - 1):
        logs, below = log_weights[offsets[m] : offsets[m + 1]], weights[offsets[m] : offsets[m + 1]]
        top = -np.inf
        for j in range(logs.size):
            top = logs[j] if logs[j] > top else top
        known = -np.inf < top < np.inf
        tops[m] = top if known else -np.inf
        for j in range(logs.size):
            below[j] = logs[j] - top if known else 0.0
    for j in range(weights.size):
        weight = exp(weights[j])
        weights[j] = weight if weights[j] > NOTHING else 0.0
    return weights, tops


@kernel
def weigh(log_weights: Floats, offsets: Ints) -> Floats:
    """(M,) effective numbers (sum w)² / sum w² of the segments, whose log-weights are normalised in place.

    They get the mean weight one. A segment without positive weights gets equal weights and the effective number 0.
    Jiang (2013), eq. (14).
    """
    effective = np.empty(offsets.size - 1)
    weights, tops = relative_weights(log_weights, offsets)
    for m in range(offsets.size - 1):
        logs, mine = log_weights[offsets[m] : offsets[m + 1]], weights[offsets[m] : offsets[m + 1]]
        whole, squares = total(mine), dot(mine, mine)
        known = tops[m] > -np.inf
        shift = tops[m] + log(whole / logs.size) if known else 0.0
        for j in range(logs.size):
            log_weight = logs[j] - shift if known else 0.0
            logs[j] = log_weight if mine[j] > 0.0 else -np.inf
        effective[m] = whole * whole / squares if known else 0.0
    return effective


@inner
def _centre(row: Floats, weights: Floats, share: float, around: Floats) -> float:
    """The mean of a row, by weights times `share`; what is beyond it is written, zero where there is no weight."""
    mean = 0.0
    for j in range(row.size):
        mean += weights[j] * row[j] if weights[j] > 0.0 else 0.0
    mean *= share
    for j in range(row.size):
        around[j] = row[j] - mean if weights[j] > 0.0 else 0.0
    return mean


@kernel
def moments(cloud: Floats, log_weights: Floats, offsets: Ints) -> tuple[Floats, Floats]:
    """Weighted means (M, D) and covariances (M, D, D) of the segments of a cloud (D, N).

    Zeros for an empty segment. A particle without weight does not count, finite or not.
    """
    size, segments = cloud.shape[0], offsets.size - 1
    means, covs = np.empty((segments, size)), np.empty((segments, size, size))
    weights, _ = relative_weights(log_weights, offsets)
    around, scaled = np.empty(cloud.shape), np.empty(weights.size)
    for m in range(segments):
        first, last = offsets[m], offsets[m + 1]
        weight, along = weights[first:last], scaled[first:last]
        share = 1.0 / max(total(weight), 1.0)
        for d in range(size):
            row = around[d, first:last]
            means[m, d] = _centre(cloud[d, first:last], weight, share, row)
            for j in range(row.size):
                along[j] = weight[j] * share * row[j]
            for e in range(d + 1):
                covs[m, d, e] = covs[m, e, d] = dot(along, around[e, first:last])
    return means, covs


@kernel
def systematic(log_weights: Floats, offsets: Ints, sizes: Ints, starts: Floats) -> Ints:
    """(sum of sizes,) columns drawn by systematic resampling: sizes[m] from segment m, first tooth at starts[m] < 1.

    A column of normalised weight w is sampled floor(size w) or ceil(size w) times, size w times on average, and never
    if w is zero. In a segment without positive weights all columns have equal weights.
    """
    wanted = 0
    for m in range(sizes.size):
        wanted += sizes[m]
    chosen = np.empty(wanted, np.int64)
    weights, _ = relative_weights(log_weights, offsets)
    drawn = 0
    for m in range(sizes.size):
        whole, final = 0.0, offsets[m]
        for j in range(offsets[m], offsets[m + 1]):
            whole += weights[j]
            if weights[j] > 0.0:
                final = j
        column, reached = offsets[m], 0.0
        for i in range(sizes[m]):
            tooth = (i + starts[m]) * whole / sizes[m]
            while reached + weights[column] <= tooth and column < final:
                reached += weights[column]
                column += 1
            chosen[drawn] = column
            drawn += 1
    return chosen
