"""A whole run of the bootstrap particle filter (Gordon, Salmond, Smith 1993) in one kernel call.

The benchmarks compare it with the same filter in C (tests/bench/reference.c). Trackers call separate kernels instead,
since a network may lose packets between two of them.

    start (4, N)               the equally weighted particles of step 0, rows px, vx, py, vy
    readings (K, S)            of S sensors at positions (S, 2) with known gains (S,), at each of K steps
    law, drift, root           the constants of `sensing` (the inflation is not used) and of `motion`
    -> means (K, 4), resampled the weighted mean at each step, and how often particles were resampled

Resampling is systematic, at steps where fewer than threshold * N particles are effective. If all likelihoods are zero
or a reading is NaN, all weights are equal. A particle that is not finite has no weight.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wsnsim.kernels.arrays import Floats, Keys
from wsnsim.kernels.compilation import inner, kernel
from wsnsim.kernels.elementary import box_muller, exp, exp2, log, log2
from wsnsim.kernels.motion import _drifted
from wsnsim.kernels.noise import uniform

Places: TypeAlias = NDArray[np.int32]
Drift: TypeAlias = tuple[float, float, float, float]
Root: TypeAlias = tuple[float, float, float]
Law: TypeAlias = tuple[float, float, float, float, float]

NOTHING = -345.0
"""A weight below e^-345 of the largest counts as 0: its square would be subnormal, and slow."""


@kernel
def run(
    start: Floats,
    readings: Floats,
    positions: Floats,
    gains: Floats,
    law: Law,
    drift: Drift,
    root: Root,
    threshold: float,
    keys: Keys,
) -> tuple[Floats, int]:
    """(K, 4) weighted means, and how often resampled, with the counter noise of a key a step (K,).

    Of step k's key, particle j takes the normal pairs 2j (axis x) and 2j + 1 (axis y), the resampling the draw 4N.
    """
    count, resampled = start.shape[1], 0
    cloud, means, scratch, places = _room(start, readings.shape[0])
    for k in range(readings.shape[0]):
        for axis in range(2):
            _draw_uniforms(keys[k], 2 * axis, scratch[0], scratch[1])
            _make_normal(scratch[0], scratch[1])
            _move(cloud[2 * axis], cloud[2 * axis + 1], scratch[0], scratch[1], drift, root)
        tooth = uniform(keys[k], 4 * count)
        _weigh(cloud[0], cloud[2], readings[k], positions, gains, law, scratch)
        resampled += _conclude(cloud, means[k], threshold, tooth, scratch, places)
    return means, resampled


@kernel
def run_with_generator(
    start: Floats,
    readings: Floats,
    positions: Floats,
    gains: Floats,
    law: Law,
    drift: Drift,
    root: Root,
    threshold: float,
    generator: np.random.Generator,
) -> tuple[Floats, int]:
    """The same with a Generator's draws, one by one: at each step a pair a particle for axis x, for axis y, a tooth."""
    resampled = 0
    cloud, means, scratch, places = _room(start, readings.shape[0])
    for k in range(readings.shape[0]):
        for axis in range(2):
            _draw(generator, scratch[0], scratch[1])
            _move(cloud[2 * axis], cloud[2 * axis + 1], scratch[0], scratch[1], drift, root)
        tooth = generator.random()
        _weigh(cloud[0], cloud[2], readings[k], positions, gains, law, scratch)
        resampled += _conclude(cloud, means[k], threshold, tooth, scratch, places)
    return means, resampled


@inner
def _room(start: Floats, steps: int) -> tuple[Floats, Floats, Floats, Places]:
    """Buffers: four rows of the cloud, means (K, 4), scratch rows (the last zero, for log-weights), two of (N + 1,)."""
    count = start.shape[1]
    scratch, places = np.empty((5, count)), np.empty((2, count + 1), np.int32)
    scratch[4] = 0.0
    return start.copy(), np.empty((steps, 4)), scratch, places


@inner
def _draw_uniforms(key: np.uint64, first: int, one: Floats, two: Floats) -> None:
    """Draws 4j + first and 4j + first + 1 of a key. Apart from what is made of them: short loops overlap better."""
    for j in range(one.size):
        one[j] = uniform(key, 4 * j + first)
        two[j] = uniform(key, 4 * j + first + 1)


@inner
def _draw(generator: np.random.Generator, one: Floats, two: Floats) -> None:
    """Write a pair of standard normals per particle."""
    for j in range(one.size):
        one[j] = generator.standard_normal()
        two[j] = generator.standard_normal()


@inner
def _make_normal(one: Floats, two: Floats) -> None:
    """Uniforms become standard normals, in place."""
    for j in range(one.size):
        one[j], two[j] = box_muller(one[j], two[j])


@inner
def _move(position: Floats, velocity: Floats, first: Floats, second: Floats, drift: Drift, root: Root) -> None:
    """Move one axis by a step, in place: A(x) x + w (Jiang 2013, eqs. 1-4)."""
    l11, l21, l22 = root
    for j in range(position.size):
        p, v = _drifted(position[j], velocity[j], drift)
        position[j] = p + l11 * first[j]
        velocity[j] = v + l21 * first[j] + l22 * second[j]


@inner
def _weigh(x: Floats, y: Floats, readings: Floats, positions: Floats, gains: Floats, law: Law, scratch: Floats) -> None:
    """Add to the log-weights the log-likelihood of all readings: - Σ (z/μ - 1)²/(2 spread) - log Π μ and a constant.

    R = spread μ² (eq. 8). Two sensors a pass share a division, and up to twenty a logarithm. In place of a sensor that
    is missing in the last pass stand a mean and a reading of one, which add nothing.
    """
    noise, intensity, decay, spread, _ = law
    square, product, mean, other, log_weights = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    for j in range(x.size):
        square[j], product[j] = 0.0, 1.0
    for s in range(0, readings.size, 2):
        _means(x, y, positions[s], gains[s] * intensity, noise, -0.5 * decay, mean)
        z, z_other = readings[s], 1.0
        if s + 1 < readings.size:
            z_other = readings[s + 1]
            _means(x, y, positions[s + 1], gains[s + 1] * intensity, noise, -0.5 * decay, other)
        else:
            other[:] = 1.0
        for j in range(x.size):
            both = mean[j] * other[j]
            inverse = 1.0 / both
            off, off_other = z * other[j] * inverse - 1.0, z_other * mean[j] * inverse - 1.0
            square[j] += off * off + off_other * off_other
            product[j] *= both
        if s % 20 == 18 or s + 2 >= readings.size:
            for j in range(x.size):
                log_weights[j] -= log(product[j])
                product[j] = 1.0
    for j in range(x.size):
        value = log_weights[j] - 0.5 / spread * square[j]
        known = (abs(x[j]) < np.inf) & (abs(y[j]) < np.inf)
        log_weights[j] = value if known else -np.inf


@inner
def _means(x: Floats, y: Floats, sensor: Floats, loudness: float, noise: float, slope: float, mean: Floats) -> None:
    """Write μ = σ² + g I d^-α with d of at least 1 m (eqs. 6-7). Two short loops overlap better than a long one."""
    x_sensor, y_sensor = sensor[0], sensor[1]
    for j in range(x.size):
        squared = (x[j] - x_sensor) ** 2 + (y[j] - y_sensor) ** 2
        mean[j] = slope * log2(squared if squared > 1.0 else 1.0)
    for j in range(x.size):
        mean[j] = noise + loudness * exp2(mean[j])


@inner
def _conclude(cloud: Floats, mean: Floats, threshold: float, tooth: float, scratch: Floats, places: Places) -> int:
    """Write the weighted mean; resample the cloud if too few particles are effective. Return 1 if it was resampled."""
    reached, weights, spare, log_weights = scratch[0], scratch[2], scratch[3], scratch[4]
    total, effective = _relative(log_weights, weights)
    _mean(cloud, weights, total, mean)
    if effective >= threshold * weights.size:
        return 0
    _choose(weights, total, tooth, reached, places[0], places[1])
    _take(cloud, places[1], spare, log_weights)
    return 1


@inner
def _relative(log_weights: Floats, weights: Floats) -> tuple[float, float]:
    """Weights relative to the largest are written; their sum, and the effective number (sum w)² / sum w².

    If the largest weight is 0 or infinite, all are 1, and the effective number is 0.
    """
    top = -np.inf
    for j in range(log_weights.size):
        top = log_weights[j] if log_weights[j] > top else top
    if not -np.inf < top < np.inf:
        for j in range(weights.size):
            weights[j] = 1.0
        return float(weights.size), 0.0
    total, squares = 0.0, 0.0
    for j in range(log_weights.size):
        below = log_weights[j] - top
        weight = exp(below if below > NOTHING else NOTHING)
        weight = weight if below > NOTHING else 0.0
        weights[j] = weight
        total += weight
        squares += weight * weight
    return total, total * total / squares


@inner
def _mean(cloud: Floats, weights: Floats, total: float, mean: Floats) -> None:
    """The weighted mean (4,) is written; what has no weight does not count, finite or not."""
    for d in range(4):
        row = cloud[d]
        mean[d] = 0.0
        reached = 0.0
        for j in range(weights.size):
            reached += weights[j] * row[j] if weights[j] > 0.0 else 0.0
        mean[d] = reached / total


@inner
def _choose(weights: Floats, total: float, tooth: float, reached: Floats, begins: Places, chosen: Places) -> None:
    """Systematic resampling without branches: N columns are written to `chosen` (N + 1,), whose last place is scrap.

    Column j is drawn by the teeth i + `tooth` between the sums of weights before it and with it. It is noted where its
    teeth begin; the next column overwrites it if it has none; a running maximum fills the rest.
    """
    count, sum_before = weights.size, 0.0
    for j in range(count):
        reached[j] = sum_before
        sum_before += weights[j]
        chosen[j] = 0
    scale = count / total
    for j in range(count):
        place = min(np.ceil(reached[j] * scale - tooth), float(count))
        begins[j] = np.int32(place if weights[j] > 0.0 else float(count))
    for j in range(count):
        chosen[begins[j]] = j
    last = np.int32(0)
    for i in range(count):
        last = max(last, chosen[i])
        chosen[i] = last


@inner
def _take(cloud: Floats, chosen: Places, spare: Floats, log_weights: Floats) -> None:
    """Replace the cloud by the chosen columns, equally weighted."""
    for d in range(4):
        row = cloud[d]
        for j in range(spare.size):
            spare[j] = row[chosen[j]]
        for j in range(spare.size):
            row[j] = spare[j]
    for j in range(log_weights.size):
        log_weights[j] = 0.0
