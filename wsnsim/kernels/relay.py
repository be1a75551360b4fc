"""Kalman filters that estimate which sensor's measurement comes from the target (Liu, Wang 2012).

    mix            one filter per sensor: the mixtures from which they start a step, eqs. 20-23
    filter_each    then each predicts and updates with its own reading, eqs. 10-20, and all are combined, eqs. 24-25;
                   from one start for all, the filter that relays from sensor to sensor, eqs. 8-14, 18-20
    kalman         the extended Kalman filter's joint update with all readings, to compare with

n sensors, D state columns, P (1 or 2) of them the position: `columns`. One filter per sensor has means (D, n)
and covs (D, D, n). Sensors are linearised at N points: expected, variances (n, N), gradients (n, P, N). `stay` is the
diagonal of the Markov matrix M, whose other entries are (1 - stay) / (n - 1); a single sensor stays. Results are
written to given arrays, since passing new ones to Python takes longer than computing them.

A measurement (n,) that is NaN was not received. An innovation that is not finite, or whose
variance is not positive and finite, counts as not received. Likelihoods are logs, of which the greatest is subtracted;
if none is positive, the predicted probabilities stay. Covariances are updated in Joseph's form, which stays positive
definite with precise measurements.

Shared functions are inlined before compilation, since Numba would otherwise compile them again for each kernel. Loops
over columns are inside those over filters where vectorisation would gain less than its compilation takes.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.kernels.compilation import kernel, merged, ordered_kernel
from wsnsim.kernels.elementary import exp, log

NOTHING = -690.0
LEAST = 1e-300
LARGEST = 1e12
"""The greatest variance, in SI units, that the diverging sum of eq. 23 as printed may reach (our choice)."""


@merged
def _step(probabilities: Floats, stay: float) -> None:
    """Make probabilities (n,) the predicted ones M b, eq. 20, in place."""
    count, total = probabilities.size, 0.0
    for j in range(count):
        total += probabilities[j]
    for i in range(count if count > 1 else 0):
        others = (total - probabilities[i]) / (count - 1)
        probabilities[i] = stay * probabilities[i] + (1.0 - stay) * others


@merged
def _weigh(probabilities: Floats, logs: Floats) -> None:
    """Update predicted probabilities by log-likelihoods, in place, eq. 18; NaN for a reading that was not received.

    Sensors whose reading was not received keep their probability; the others share the remainder. `logs` is
    overwritten.
    """
    top, rest, total = -np.inf, 0.0, 0.0
    for i in range(logs.size):
        if logs[i] == logs[i]:
            rest += probabilities[i]
            logs[i] = logs[i] + log(probabilities[i]) if probabilities[i] > LEAST else -np.inf
            top = logs[i] if logs[i] > top else top
    if not top > -np.inf:
        return
    for i in range(logs.size):
        if logs[i] == logs[i]:
            probabilities[i] = exp(logs[i] - top) if logs[i] - top > NOTHING else 0.0
            total += probabilities[i]
    for i in range(logs.size):
        if logs[i] == logs[i]:
            probabilities[i] *= rest / total


@merged
def _condition(
    covs: Floats, lifts: Floats, inverses: Floats, slopes: Floats, variances: Floats, first: int, last: int
) -> None:
    """Replace each P by (I - G H) P (I - G H)ᵀ + G R Gᵀ = P - G H P; lifts are P Hᵀ, and G P Hᵀ / S."""
    size = lifts.shape[0]
    for i in range(inverses.size):
        for d in range(size):
            gain = lifts[d, i] * inverses[i]
            for e in range(size):
                covs[d, e, i] -= gain * lifts[e, i]
            across = covs[d, first, i] * slopes[0, i] + covs[d, last, i] * slopes[1, i]
            rest = (variances[i] * gain - across) * inverses[i]
            for e in range(size):
                covs[d, e, i] += rest * lifts[e, i]
        for d in range(size):
            for e in range(d):
                covs[d, e, i] = covs[e, d, i] = 0.5 * (covs[d, e, i] + covs[e, d, i])


@merged
def _update(
    covs: Floats, slopes: Floats, variances: Floats, innovations: Floats, columns: Ints, shifts: Floats, logs: Floats
) -> None:
    """Condition each covariance (D, D, n) on its sensor's reading, in place; eqs. 11-13, 19. Overwrites its arguments.

    slopes (2, n), of which the second is 0 where P = 1; variances, innovations (n,). G ν goes to `shifts` (D, n), and
    to `logs` (n,) log N(ν; 0, S) up to its constant: NaN if nothing can be said, -inf if ν is too large for a number;
    then the filter stays.
    """
    size, count = shifts.shape
    first, last, inverses = columns[0], columns[columns.size - 1], np.empty(count)
    for d in range(size):
        for i in range(count):
            shifts[d, i] = covs[d, first, i] * slopes[0, i] + covs[d, last, i] * slopes[1, i]  # P Hᵀ
    for i in range(count):
        width = variances[i] + slopes[0, i] * shifts[first, i] + slopes[1, i] * shifts[last, i]
        known = (0.0 < width < np.inf) and innovations[i] == innovations[i]
        logs[i] = -0.5 * (innovations[i] * innovations[i] / width + log(width)) if known else np.nan
        inverses[i] = 1.0 / width
        if not logs[i] > -np.inf:
            inverses[i] = variances[i] = innovations[i] = slopes[0, i] = slopes[1, i] = 0.0
            for d in range(size):
                shifts[d, i] = 0.0
    _condition(covs, shifts, inverses, slopes, variances, first, last)
    for d in range(size):
        for i in range(count):
            shifts[d, i] *= inverses[i] * innovations[i]


@merged
def _cap(covs: Floats) -> None:
    """Scale each covariance (D, D, n) down, in place, if a variance exceeds LARGEST; NaN becomes LARGEST."""
    size = covs.shape[0]
    for i in range(covs.shape[2]):
        largest = 0.0
        for d in range(size):
            largest = largest if covs[d, d, i] <= largest else covs[d, d, i]
        scale = 1.0 if largest <= LARGEST else LARGEST / largest
        for k in range(size * size if scale != 1.0 else 0):
            d, e = k // size, k % size
            covs[d, e, i] = covs[d, e, i] * scale if scale > 0.0 else (LARGEST if d == e else 0.0)


@kernel
def mix(
    means: Floats, covs: Floats, probabilities: Floats, stay: float, printed: bool, mixed: Floats, spreads: Floats
) -> None:
    """Write the mixtures from which the filters start a step to `mixed` (D, n) and `spreads` (D, D, n): eqs. 20-23.

    `probabilities` (n,) are those of the last step. A filter of no predicted probability starts from itself. With
    `printed`, eq. 23 sums the covariances without their weights, as its bracket says: they grow n-fold a step, and are
    scaled down when a variance exceeds LARGEST.
    """
    size, count = means.shape
    shares, leave, total = np.empty((count, count)), (1.0 - stay) / max(count - 1, 1), 0.0
    for j in range(count):
        total += probabilities[j]
    for i in range(count):
        predicted = stay * probabilities[i] + leave * (total - probabilities[i])  # eq. 20
        alone = count == 1 or not predicted > LEAST
        for j in range(count):
            joint = probabilities[j] * (stay if i == j else leave)
            shares[j, i] = (1.0 if i == j else 0.0) if alone else joint / predicted  # eq. 21
    for d in range(size):
        for i in range(count):
            mixed[d, i] = 0.0
        for j in range(count):
            for i in range(count):
                mixed[d, i] += shares[j, i] * means[d, j]  # eq. 22
    for d in range(size):
        for e in range(d + 1):
            for i in range(count):
                spreads[d, e, i] = 0.0
            for j in range(count):
                for i in range(count):
                    around = (means[d, j] - mixed[d, i]) * (means[e, j] - mixed[e, i])
                    spreads[d, e, i] += shares[j, i] * around + (1.0 if printed else shares[j, i]) * covs[d, e, j]
            for i in range(count):  # eq. 23
                spreads[e, d, i] = spreads[d, e, i]
    if printed:
        _cap(spreads)


@merged
def _predict(covs: Floats, transitions: Floats, noise: Floats) -> None:
    """Replace each P by F P Fᵀ + Q, eq. 17; each has its own F (D, D, n)."""
    size, product = covs.shape[0], np.empty((covs.shape[0], covs.shape[0]))
    for i in range(covs.shape[2]):
        for d in range(size):
            for e in range(size):
                value = 0.0
                for k in range(size):
                    value += transitions[d, k, i] * covs[k, e, i]
                product[d, e] = value
        for d in range(size):
            for e in range(d + 1):
                value = noise[d, e]
                for k in range(size):
                    value += product[d, k] * transitions[e, k, i]
                covs[d, e, i] = covs[e, d, i] = value


@ordered_kernel
def filter_each(
    means: Floats,
    covs: Floats,
    probabilities: Floats,
    transitions: Floats,
    noise: Floats,
    expected: Floats,
    gradients: Floats,
    variances: Floats,
    readings: Floats,
    columns: Ints,
    stay: float,
    spread: bool,
    mean: Floats,
    cov: Floats,
) -> None:
    """Predict each filter's covariance, and update filters and probabilities with each sensor's reading, in place.

    Means come in as predicted, probabilities as of the last step; transitions (D, D, n), noise (D, D) are F and Q. With
    transitions (D, D, 0) the covariances, too, come in as predicted. Sensor i is linearised at the prediction of filter
    i, or at the only point. If it is not heard, its filter stays at the prediction. Eqs. 10-13 for b = 1, 17-20. To
    `mean` (D,), `cov` (D, D) go the moments of the mixture, eqs. 24, 25: without `spread` the average of the
    covariances alone.

    Where all filters start from one mean and covariance, these moments are the relaying filter's: eqs. 10, and 14,
    which has no spread. For the probabilities are one in all, and so P⁻ - sum b G H P⁻ is an average of what each
    reading alone makes of P⁻.
    """
    size, count = means.shape
    shifts, table, slopes = np.empty((size, count)), np.empty((3, count)), np.empty((2, count))
    for i in range(count):
        j = i if expected.shape[1] > 1 else 0
        table[0, i], table[1, i] = variances[i, j], readings[i] - expected[i, j]
        slopes[0, i], slopes[1, i] = gradients[i, 0, j], gradients[i, 1, j] if columns.size > 1 else 0.0
    if transitions.shape[2] == count:
        _predict(covs, transitions, noise)
    _update(covs, slopes, table[0], table[1], columns, shifts, table[2])
    _step(probabilities, stay)
    _weigh(probabilities, table[2])
    for d in range(size):
        total = 0.0
        for i in range(count):
            means[d, i] += shifts[d, i]
            total += probabilities[i] * means[d, i]
        mean[d] = total
        for i in range(count):
            shifts[d, i] = means[d, i] - total if spread else 0.0
        for e in range(d + 1):
            value = 0.0
            for i in range(count):
                value += probabilities[i] * (covs[d, e, i] + shifts[d, i] * shifts[e, i])
            cov[d, e] = cov[e, d] = value


@ordered_kernel
def kalman(
    mean: Floats, cov: Floats, expected: Floats, gradients: Floats, variances: Floats, readings: Floats, columns: Ints
) -> tuple[float, int]:
    """Update mean (D,) and covariance (D, D) with S readings, linearised at the given mean, in place.

    Returns the normalised innovation squared νᵀ S⁻¹ ν, and the number of readings used: the innovation of each reading
    given those before it is white, so that their squares sum to that of the joint update.

    expected, variances (S, 1), gradients (S, P, 1). Readings are processed in turn, all linearised at the same point,
    in Joseph's form: this equals the joint update. A reading whose innovation is not finite, or has no finite positive
    variance, is skipped. Bar-Shalom, Li, Kirubarajan (2001), 5.2, 10.3.
    """
    size, square, used = mean.size, 0.0, 0
    moved, lift, work = np.empty(size), np.empty(size), np.empty((size, size))
    for d in range(size):
        moved[d] = 0.0
    for s in range(readings.size):
        width, innovation = variances[s, 0], readings[s] - expected[s, 0]
        for d in range(size):
            lift[d] = 0.0
            for p in range(columns.size):
                lift[d] += cov[d, columns[p]] * gradients[s, p, 0]
        for p in range(columns.size):
            width += gradients[s, p, 0] * lift[columns[p]]
            innovation -= gradients[s, p, 0] * moved[columns[p]]
        if not (0.0 < width < np.inf and -np.inf < innovation < np.inf):
            continue
        square, used = square + innovation * innovation / width, used + 1
        for d in range(size):
            rest = variances[s, 0] * lift[d] / width
            for e in range(size):
                work[d, e] = cov[d, e] - lift[d] / width * lift[e]
            for p in range(columns.size):
                rest -= work[d, columns[p]] * gradients[s, p, 0]
            for e in range(size):
                work[d, e] += rest / width * lift[e]
        for d in range(size):
            moved[d] += lift[d] * (innovation / width)
            for e in range(size):
                cov[d, e] = 0.5 * (work[d, e] + work[e, d])
    for d in range(size):
        mean[d] += moved[d]
    return square, used
