"""Probabilities that tracks made detections: exact, and by loopy belief propagation.

likelihoods (T, M): of detection j by track i, the probability of detection included; 0 outside the gate
miss (T,): the probability that a track makes no detection      clutter (M,): the density of false detections at each

The weight of a joint event, in which a track makes at most one detection and a detection has at most one origin, is the
product of the likelihoods of its pairs, of `miss` of the other tracks and of `clutter` of the other detections. Tracks
that share no detection, not even through others, are independent: each such cluster is computed by itself.

The exact sums share their parts: tracks and detections are exchangeable, and the events of the first n rows only matter
by the set of columns that they use, 2^m of the smaller side. Beyond `most` columns, belief propagation takes over.

Source: Fortmann, Bar-Shalom, Scheffe (1983) for the events; Williams, Lau (2014) for belief propagation.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.kernels.compilation import inner, kernel

LEAST = 1e-15
"""Least `miss` and `clutter`, relative to the likelihoods beside them: every joint event stays possible."""
ACCURACY = 1e-9
"""The relative error of the probabilities at the fixed point of belief propagation, at which it may end."""
ITERATIONS = 10_000
"""Most iterations of belief propagation, which converges slowly if detection is nearly certain (our choice)."""


@kernel
def associate(likelihoods: Floats, miss: Floats, clutter: Floats, most: int) -> Floats:
    """The probability (T, M + 1) that each track made detection j, in column j + 1, or none, in column 0.

    Args:
        likelihoods: (T, M).
        miss: (T,).
        clutter: (M,).
        most: Clusters with more tracks and more detections than this are computed by belief propagation.
    """
    tracks, detections = likelihoods.shape
    result, cluster = np.zeros((tracks, detections + 1)), np.full(tracks, -1)
    for i in range(tracks):
        result[i, 0] = 1.0
    for seed in range(tracks):
        if cluster[seed] >= 0:
            continue
        rows, columns = _cluster(likelihoods, seed, cluster)
        if not columns.size:
            continue
        weights, alone, false = _scaled(likelihoods, miss, clutter, rows, columns)
        if rows.size < columns.size and rows.size <= most:
            pairs = np.ascontiguousarray(_exact(np.ascontiguousarray(weights.T), false, alone).T)
        elif columns.size <= most:
            pairs = _exact(weights, alone, false)
        else:
            pairs = _propagated(weights, alone, false)
        for i in range(rows.size):
            whole = 0.0
            for j in range(columns.size):
                result[rows[i], columns[j] + 1] = pairs[i, j]
                whole += pairs[i, j]
            result[rows[i], 0] = max(1.0 - whole, 0.0)
    return result


@inner
def _cluster(likelihoods: Floats, seed: int, cluster: Ints) -> tuple[Ints, Ints]:
    """The tracks and detections that hang together with a track; `cluster` (T,) of these becomes its number."""
    tracks, detections = likelihoods.shape
    known, waiting, count = np.zeros(detections, np.bool_), np.empty(tracks, np.int64), 1
    waiting[0] = seed
    cluster[seed] = seed
    place = 0
    while place < count:
        i = waiting[place]
        place += 1
        for j in range(detections):
            if likelihoods[i, j] > 0.0 and not known[j]:
                known[j] = True
                for other in range(tracks):
                    if cluster[other] < 0 and likelihoods[other, j] > 0.0:
                        cluster[other] = seed
                        waiting[count] = other
                        count += 1
    return np.sort(waiting[:count]), np.nonzero(known)[0]


@inner
def _scaled(
    likelihoods: Floats, miss: Floats, clutter: Floats, rows: Ints, columns: Ints
) -> tuple[Floats, Floats, Floats]:
    """Weights (t, m), (t,) and (m,) of a cluster: the greatest that a row or a column may take is 1, none is 0."""
    weights, alone, false = np.empty((rows.size, columns.size)), np.empty(rows.size), np.empty(columns.size)
    for j in range(columns.size):
        top = clutter[columns[j]]
        for i in range(rows.size):
            weights[i, j] = likelihoods[rows[i], columns[j]]
            top = max(top, weights[i, j])
        false[j] = max(clutter[columns[j]] / top, LEAST)
        for i in range(rows.size):
            weights[i, j] /= top
    for i in range(rows.size):
        top = miss[rows[i]]
        for j in range(columns.size):
            top = max(top, weights[i, j])
        alone[i] = max(miss[rows[i]] / top, LEAST)
        for j in range(columns.size):
            weights[i, j] /= top
    return weights, alone, false


@inner
def _exact(weights: Floats, alone: Floats, unused: Floats) -> Floats:
    """(n, m) the probability of each pair of a row and a column.

    `before` are sums over the events of the rows above by the set of columns that they use, `after` those of this row
    and the rows below, given that set.
    """
    rows, columns = weights.shape
    sets = 1 << columns
    after, before, later = np.empty((rows + 1, sets)), np.zeros(sets), np.empty(sets)
    for used in range(sets):
        after[rows, used] = 1.0
        for j in range(columns):
            if not used >> j & 1:
                after[rows, used] *= unused[j]
    for i in range(rows - 1, -1, -1):
        for used in range(sets):
            value = alone[i] * after[i + 1, used]
            for j in range(columns):
                if not used >> j & 1:
                    value += weights[i, j] * after[i + 1, used | 1 << j]
            after[i, used] = value
    result, whole = np.zeros((rows, columns)), after[0, 0]
    before[0] = 1.0
    for i in range(rows):
        for used in range(sets):
            later[used] = alone[i] * before[used]
        for used in range(sets):
            if before[used] > 0.0:
                for j in range(columns):
                    if weights[i, j] > 0.0 and not used >> j & 1:
                        value = before[used] * weights[i, j]
                        later[used | 1 << j] += value
                        result[i, j] += value * after[i + 1, used | 1 << j] / whole
        for used in range(sets):
            before[used] = later[used]
    return result


@inner
def _propagated(weights: Floats, alone: Floats, false: Floats) -> Floats:
    """(t, m) the probabilities of pairs at the fixed point of belief propagation (Williams, Lau 2014).

    `to_tracks` are the messages of detections to tracks. Their logarithms contract: with the greatest ratio e^d of
    successive messages and w* = max Σ w, by at least α = log((1 + w* e^d) / (1 + w*)) / d. So they are within
    α d / (1 - α) of the fixed point, and the probabilities within a factor 1 + `ACCURACY` as soon as that is below
    log(1 + `ACCURACY`) / 2.
    """
    tracks, detections = weights.shape
    ratios = np.empty(weights.shape)
    sharpest = 0.0
    for i in range(tracks):
        total = 0.0
        for j in range(detections):
            ratios[i, j] = weights[i, j] / (alone[i] * false[j])
            total += ratios[i, j]
        sharpest = max(sharpest, total)
    to_tracks, to_detections, enough = np.ones(weights.shape), np.empty(weights.shape), 0.5 * np.log1p(ACCURACY)
    for _ in range(ITERATIONS):
        distance = 0.0
        for i in range(tracks):
            for j in range(detections):
                others = 1.0
                for k in range(detections):
                    others += ratios[i, k] * to_tracks[i, k] if k != j else 0.0
                to_detections[i, j] = ratios[i, j] / others
        for j in range(detections):
            for i in range(tracks):
                others = 1.0
                for k in range(tracks):
                    others += to_detections[k, j] if k != i else 0.0
                distance = max(distance, abs(np.log(others * to_tracks[i, j])))
                to_tracks[i, j] = 1.0 / others
        if distance < LEAST:
            break
        contraction = np.log((1.0 + sharpest * np.exp(distance)) / (1.0 + sharpest)) / distance
        if contraction * (distance + enough) < enough:
            break
    for i in range(tracks):
        total = 1.0
        for j in range(detections):
            total += ratios[i, j] * to_tracks[i, j]
        for j in range(detections):
            to_tracks[i, j] *= ratios[i, j] / total
    return to_tracks
