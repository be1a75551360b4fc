"""Kalman filters that reckon with which sensor's reading comes from the target (Liu, Wang 2012).

    rkf            one filter that relays from sensor to sensor: eqs. 8-14, 18-20
    mix, update_each, combine    a filter a sensor, mixed at each step: eqs. 20-23, 10-14 and 18-19 in each, 24-25
    kalman         the extended Kalman filter's joint update with all readings, to compare with

n sensors, D state columns, P of them the position in the rows `place`. One filter has its mean (D,) and cov (D, D); a
filter a sensor has means (D, n), covs (n, D, D). `readings` (n,) count where `heard` (n,). `stay` is the diagonal of
the Markov matrix M, whose other entries are (1 - stay) / (n - 1); a single sensor stays.

What is no number does no harm: a reading, or an innovation variance that is not positive and finite, counts as not
heard. Likelihoods are logs, the greatest of them subtracted once; where none is positive, the predicted probabilities
stay. Covariances are updated in Joseph's form, which sharp readings do not make indefinite.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wsnsim.kernels.elementary import exp, log
from wsnsim.kernels.noise import INNER, SWITCHES

Bools: TypeAlias = NDArray[np.bool_]
Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]

NOTHING = -690.0
LEAST = 1e-300
LARGEST = 1e12
"""The greatest variance, in SI units, that the diverging sum of eq. 23 as printed may reach (our choice)."""


@njit(**INNER)
def _stepped(probabilities: Floats, stay: float) -> Floats:
    """(n,) predicted probabilities M b, eq. 20."""
    count = probabilities.size
    leave = (1.0 - stay) / max(count - 1, 1)
    result, total = np.empty(count), 0.0
    for j in range(count):
        total += probabilities[j]
    for i in range(count):
        result[i] = stay * probabilities[i] + leave * (total - probabilities[i]) if count > 1 else total
    return result


@njit(**INNER)
def _weigh(probabilities: Floats, logs: Floats) -> None:
    """From predicted to updated probabilities by log-likelihoods, in place, eq. 18; a NaN is a sensor not heard.

    Those not heard keep theirs; the rest share the remainder.
    """
    scores, top, rest = np.empty(logs.size), -np.inf, 0.0
    for i in range(logs.size):
        scores[i] = -np.inf
        if logs[i] == logs[i]:
            rest += probabilities[i]
            if probabilities[i] > LEAST:
                scores[i] = logs[i] + log(probabilities[i])
        top = scores[i] if scores[i] > top else top
    if not top > -np.inf:
        return
    total = 0.0
    for i in range(logs.size):
        scores[i] = exp(scores[i] - top) if scores[i] - top > NOTHING else 0.0
        total += scores[i]
    for i in range(logs.size):
        if logs[i] == logs[i]:
            probabilities[i] = rest * scores[i] / total


@njit(forceinline=True, **INNER)
def _lift(cov, slope, variance, place, lift):
    """Write P Hᵀ (D,) to `lift` and give S = H P Hᵀ + R, eq. 13."""
    width = variance
    for d in range(lift.size):
        lift[d] = 0.0
        for p in range(place.size):
            lift[d] += cov[d, place[p]] * slope[p]
    for p in range(place.size):
        width += slope[p] * lift[place[p]]
    return width


@njit(forceinline=True, **INNER)
def _log_likelihood(surprise, width, heard):
    """log N(ν; 0, S) up to its constant, eq. 19; NaN if nothing can be said, -inf if ν is too large for a number."""
    if not (heard and 0.0 < width < np.inf and surprise == surprise):
        return np.nan
    return -0.5 * (surprise * surprise / width + log(width))


@njit(forceinline=True, **INNER)
def _set_updated(work, cov, lift, inverse, slope, variance, place):
    """Write (I - G H) P (I - G H)ᵀ + G R Gᵀ = P - G H P to `work`, whose symmetric part is meant; G = lift inverse."""
    for d in range(lift.size):
        gain, rest = lift[d] * inverse, 0.0
        for e in range(lift.size):
            work[d, e] = cov[d, e] - gain * lift[e]
        for p in range(place.size):
            rest += work[d, place[p]] * slope[p]
        rest = (variance * gain - rest) * inverse
        for e in range(lift.size):
            work[d, e] += rest * lift[e]


@njit(**SWITCHES)
def rkf(
    mean: Floats,
    cov: Floats,
    probabilities: Floats,
    expected: Floats,
    gradients: Floats,
    variances: Floats,
    readings: Floats,
    heard: Bools,
    place: Ints,
    stay: float,
    spread: bool,
) -> tuple[Floats, Floats, Floats]:
    """Mean (D,), covariance (D, D) and probabilities (n,) after the readings, from the prediction and the last ones.

    expected, variances (n,), gradients (n, P) at the predicted mean. Eq. 14 as printed; with `spread`, that of the
    updated means is added, as in probabilistic data association. Since the probabilities do not exceed one in all,
    P⁻ - sum b G H P⁻ is an average of P⁻ and of what each reading alone would make of it, and so it is worked out.
    """
    size, count = mean.size, readings.size
    updated = _stepped(probabilities, stay)
    lift, work, logs = np.empty(size), np.empty((size, size)), np.empty(count)
    for i in range(count):
        width = _lift(cov, gradients[i], variances[i], place, lift)
        logs[i] = _log_likelihood(readings[i] - expected[i], width, heard[i])
    _weigh(updated, logs)
    shift, after, result, unused = np.zeros(size), np.empty(size), np.zeros((size, size)), 1.0
    for i in range(count):
        if not (logs[i] > -np.inf and updated[i] > 0.0):
            continue
        width = _lift(cov, gradients[i], variances[i], place, lift)
        scale = (readings[i] - expected[i]) / width
        unused -= updated[i]
        _set_updated(work, cov, lift, 1.0 / width, gradients[i], variances[i], place)
        for d in range(size):
            shift[d] += updated[i] * lift[d] * scale  # eqs. 10-12
            added = lift[d] * scale * scale if spread else 0.0
            for e in range(d + 1):
                result[d, e] += updated[i] * (0.5 * (work[d, e] + work[e, d]) + added * lift[e])  # eq. 14
    unused = max(unused, 0.0)
    for d in range(size):
        after[d] = mean[d] + shift[d]
        for e in range(d + 1):
            result[d, e] += unused * cov[d, e] - (shift[d] * shift[e] if spread else 0.0)
            result[e, d] = result[d, e]
    return after, result, updated


@njit(**INNER)
def _cap(cov: Floats) -> None:
    """Scale a covariance down, in place, if a variance exceeds LARGEST; what is no number becomes that."""
    largest = 0.0
    for d in range(cov.shape[0]):
        largest = largest if cov[d, d] <= largest else cov[d, d]
    if largest <= LARGEST:
        return
    for d in range(cov.shape[0]):
        for e in range(cov.shape[0]):
            if largest < np.inf:
                cov[d, e] *= LARGEST / largest
            else:
                cov[d, e] = LARGEST if d == e else 0.0


@njit(forceinline=True, **INNER)
def _set_shares(shares, i, probabilities, predicted, stay):
    """Write b_{j|i} (n,), eq. 21, to `shares`: of what filter i starts from; from itself if it is not probable."""
    count = shares.size
    if count == 1 or not predicted > LEAST:
        for j in range(count):
            shares[j] = 1.0 if i == j else 0.0
        return
    others = (1.0 - stay) / (count - 1) / predicted
    for j in range(count):
        shares[j] = others * probabilities[j]
    shares[i] = stay * probabilities[i] / predicted


@njit(**SWITCHES)
def mix(
    means: Floats, covs: Floats, probabilities: Floats, stay: float, printed: bool
) -> tuple[Floats, Floats, Floats]:
    """What each filter starts its step from: mixed means (D, n), covariances (n, D, D), predicted probabilities (n,).

    A filter of no predicted probability starts from itself. With `printed`, eq. 23 sums the covariances without their
    weights, as its bracket says: they grow n-fold a step, and are scaled down when a variance exceeds LARGEST. `covs`
    must be contiguous.
    """
    size, count = means.shape
    predicted = _stepped(probabilities, stay)
    mixed, spreads = np.empty((size, count)), np.zeros((count, size, size))
    shares, around = np.empty(count), np.empty((size, count))
    flat, into = covs.reshape((count, size * size)), spreads.reshape((count, size * size))
    for i in range(count):
        _set_shares(shares, i, probabilities, predicted[i], stay)
        for d in range(size):
            total = 0.0
            for j in range(count):
                total += shares[j] * means[d, j]  # eq. 22
            mixed[d, i] = total
            for j in range(count):
                around[d, j] = means[d, j] - total
        for j in range(count):
            share = 1.0 if printed else shares[j]
            for k in range(size * size):
                into[i, k] += share * flat[j, k]  # eq. 23
        for d in range(size):
            for e in range(d + 1):
                total = spreads[i, d, e]
                for j in range(count):
                    total += shares[j] * around[d, j] * around[e, j]
                spreads[i, d, e] = total
                spreads[i, e, d] = total
        if printed:
            _cap(spreads[i])
    return mixed, spreads, predicted


@njit(**SWITCHES)
def combine(means: Floats, covs: Floats, probabilities: Floats) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of the mixture of all filters: eqs. 24, 25."""
    size, count = means.shape
    mean, cov, around = np.zeros(size), np.zeros((size, size)), np.empty(size)
    for i in range(count):
        for d in range(size if probabilities[i] > 0.0 else 0):
            mean[d] += probabilities[i] * means[d, i]
    for i in range(count):
        for d in range(size if probabilities[i] > 0.0 else 0):
            around[d] = mean[d] - means[d, i]
            for e in range(d + 1):
                cov[d, e] += probabilities[i] * (covs[i, d, e] + around[d] * around[e])
    for d in range(size):
        for e in range(d):
            cov[e, d] = cov[d, e]
    return mean, cov


@njit(forceinline=True, **INNER)
def _update(cov, lift, inverse, slope, variance, place, work):
    """Put P - G H P in the place of P."""
    _set_updated(work, cov, lift, inverse, slope, variance, place)
    for d in range(lift.size):
        for e in range(d + 1):
            cov[d, e] = 0.5 * (work[d, e] + work[e, d])
            cov[e, d] = cov[d, e]


@njit(**SWITCHES)
def update_each(
    means: Floats,
    covs: Floats,
    probabilities: Floats,
    expected: Floats,
    gradients: Floats,
    variances: Floats,
    readings: Floats,
    heard: Bools,
    place: Ints,
) -> tuple[Floats, Floats]:
    """Update each sensor's filter with its own reading, and the predicted probabilities (n,), in place; then `combine`.

    expected, variances (n, n), gradients (n, P, n): of sensor i at filter j's prediction, of which i = j is used. A
    sensor that is not heard leaves its filter at the prediction. Eqs. 10-13 with b = 1, 18, 19.
    """
    size, count = means.shape
    logs, lift, work = np.empty(count), np.empty(size), np.empty((size, size))
    slope = np.empty(place.size)
    for i in range(count):
        for p in range(place.size):
            slope[p] = gradients[i, p, i]
        width = _lift(covs[i], slope, variances[i, i], place, lift)
        surprise = readings[i] - expected[i, i]
        logs[i] = _log_likelihood(surprise, width, heard[i])
        if logs[i] > -np.inf:
            _update(covs[i], lift, 1.0 / width, slope, variances[i, i], place, work)
            for d in range(size):
                means[d, i] += lift[d] * (surprise / width)
    _weigh(probabilities, logs)
    return combine(means, covs, probabilities)


@njit(**SWITCHES)
def kalman(
    mean: Floats, cov: Floats, expected: Floats, gradients: Floats, variances: Floats, readings: Floats, place: Ints
) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) after S readings, linearised at the mean as it comes in: the joint update.

    expected, variances (S,), gradients (S, P). Reading after reading with one fixed point of linearisation, each in
    Joseph's form; a reading of which nothing can be said is passed over. Bar-Shalom, Li, Kirubarajan (2001), 5.2, 10.3.
    """
    size = mean.size
    after, within = mean.copy(), cov.copy()
    lift, work = np.empty(size), np.empty((size, size))
    for s in range(readings.size):
        width = _lift(within, gradients[s], variances[s], place, lift)
        surprise = readings[s] - expected[s]
        for p in range(place.size):
            surprise -= gradients[s, p] * (after[place[p]] - mean[place[p]])
        if not (0.0 < width < np.inf and -np.inf < surprise < np.inf):
            continue
        _update(within, lift, 1.0 / width, gradients[s], variances[s], place, work)
        for d in range(size):
            after[d] += lift[d] * (surprise / width)
    return after, within
