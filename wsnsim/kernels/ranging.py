"""Readings of a distance with noise of constant variance, for many points at once.

    law = (a, b, d_0, R, within, logarithmic)     the sensor's constants: five floats and a boolean
    mean m = a + b d, or a + b log d if logarithmic, with d of at least d_0; m = 0 beyond `within`     z = m + N(0, R)

It is the range of Liu and Wang (2012) and of Wei and Guo (2022), and the log-distance law of Ruan et al. (2020, eq. 4).
Points are given by their coordinates x (N,) and y (N,). Positions are (S, 2), or (S, 3) with a squared difference in
height, which d² includes. The log-likelihood is -inf for a point that is not finite and for a reading that is NaN; it
is never NaN.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.kernels.compilation import inlined, kernel
from wsnsim.kernels.elementary import LOG_TWO_PI, close, log

Law: TypeAlias = tuple[float, float, float, float, float, bool]


@inlined
def _set_forms(form: Floats, squared: Floats, least: float, logarithmic: bool) -> None:
    """Write d, or log d if logarithmic, to `form`, given d², which is at least `least` (positive if logarithmic).

    Each law has a loop of its own, so that both vectorise.
    """
    if logarithmic:
        for j in range(form.size):
            form[j] = 0.5 * log(squared[j] if squared[j] > least else least)
    else:
        for j in range(form.size):
            form[j] = np.sqrt(squared[j] if squared[j] > least else least)


@inlined
def _lift(squared: Floats, positions: Floats, s: int) -> None:
    """Add the squared difference in height of sensor s to d², if positions have it.

    A loop of its own leaves the bits of distances in the plane as they are without heights.
    """
    if positions.shape[1] > 2:
        for j in range(squared.size):
            squared[j] += positions[s, 2]


@kernel
def own_log_likelihood(x: Floats, y: Floats, readings: Floats, positions: Floats, owners: Ints, law: Law) -> Floats:
    """(N,) log p(readings[owners[j]] | target at point j): every particle against its own node's reading.

    What belongs to the owners is collected first, so that the second loop vectorises. Raises IndexError for an
    unknown owner.
    """
    offset, slope, floor, variance, within, logarithmic = law
    squared, reading = np.empty(x.size), np.empty(x.size)
    for j in range(x.size):
        s = owners[j]
        if s < 0 or s >= readings.size:
            raise IndexError("a particle is owned by a reading that is not there")
        squared[j] = (x[j] - positions[s, 0]) ** 2 + (y[j] - positions[s, 1]) ** 2
        reading[j] = readings[s]
    if positions.shape[1] > 2:
        for j in range(x.size):
            squared[j] += positions[owners[j], 2]
    result, form = np.empty(x.size), np.empty(x.size)
    _set_forms(form, squared, floor * floor, logarithmic)
    for j in range(x.size):
        mean = offset + slope * form[j]
        result[j] = (reading[j] - (mean if squared[j] <= within * within else 0.0)) ** 2
    close(result, x, y, LOG_TWO_PI + log(variance), variance)
    return result


@kernel
def joint_log_likelihood(x: Floats, y: Floats, readings: Floats, positions: Floats, law: Law) -> Floats:
    """(N,) log p(all S readings | target at point j)."""
    offset, slope, floor, variance, within, logarithmic = law
    result, squared, form = np.zeros(x.size), np.empty(x.size), np.empty(x.size)
    for s in range(readings.size):
        reading, x_sensor, y_sensor = readings[s], positions[s, 0], positions[s, 1]
        for j in range(x.size):
            squared[j] = (x[j] - x_sensor) ** 2 + (y[j] - y_sensor) ** 2
        _lift(squared, positions, s)
        _set_forms(form, squared, floor * floor, logarithmic)
        for j in range(x.size):
            mean = offset + slope * form[j]
            result[j] += (reading - (mean if squared[j] <= within * within else 0.0)) ** 2
    close(result, x, y, readings.size * (LOG_TWO_PI + log(variance)), variance)
    return result


@kernel
def linearised(x: Floats, y: Floats, positions: Floats, law: Law) -> tuple[Floats, Floats, Floats]:
    """Expected readings (S, N), their gradients in x and y (S, 2, N), and variances (S, N), within range or not.

    ∂m/∂x = b (x - x_s) / d, or b (x - x_s) / d² if logarithmic, and 0 below the least distance and at d = 0. A point
    that is not finite is infinitely far, with the gradient 0.
    """
    offset, slope, floor, variance, _, logarithmic = law
    sensors = positions.shape[0]
    means = np.empty((sensors, x.size))
    gradients = np.empty((sensors, 2, x.size))
    variances = np.full((sensors, x.size), variance)
    squared, form = np.empty(x.size), np.empty(x.size)
    for s in range(sensors):
        x_sensor, y_sensor = positions[s, 0], positions[s, 1]
        for j in range(x.size):
            squared[j] = (x[j] - x_sensor) ** 2 + (y[j] - y_sensor) ** 2
        _lift(squared, positions, s)
        _set_forms(form, squared, floor * floor, logarithmic)
        for j in range(x.size):
            known = squared[j] < np.inf
            means[s, j] = offset + slope * (form[j] if known else np.inf)
            sloping = (squared[j] > floor * floor) & known
            factor = slope / (squared[j] if logarithmic else form[j])
            gradients[s, 0, j] = factor * (x[j] - x_sensor) if sloping else 0.0
            gradients[s, 1, j] = factor * (y[j] - y_sensor) if sloping else 0.0
    return means, gradients, variances
