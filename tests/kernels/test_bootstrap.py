"""The whole-run bootstrap filter, against NumPy with the same noise, a grid, and its other source of noise."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from wsnsim.base.rng import derive_all, uniforms
from wsnsim.kernels import motion
from wsnsim.kernels.bootstrap import run, run_with_generator
from wsnsim.kernels.compilation import OPTIONS
from wsnsim.kernels.elementary import exp2, log2

DRIFT, ROOT, LAW = (0.04, 180.0, 0.75, 1.0), (0.0008, 0.04, 0.005), (1.0, 1e4, 2.2, 0.003, 0.0)
SD = np.array([3.0, 1.0, 3.0, 1.0])


def run_twin(start, readings, positions, gains, law, drift, root, threshold, keys):
    """The same filter in NumPy: one step after the other, all particles at once."""
    noise, intensity, decay, spread, _ = law
    cloud, log_weights, means, resampled = start.copy(), np.zeros(start.shape[1]), [], 0
    for key, row in zip(keys, readings, strict=True):
        cloud = moved(cloud, key, drift, root)
        apart = cloud[[0, 2]] - positions[:, :, None]
        squared = np.maximum((apart**2).sum(axis=1), 1.0)
        mean = noise + gains[:, None] * intensity * squared ** (-decay / 2)
        log_weights = log_weights - ((row[:, None] / mean - 1.0) ** 2 / (2.0 * spread) + np.log(mean)).sum(axis=0)
        weights = np.exp(log_weights - log_weights.max())
        shares = weights / weights.sum()
        means.append(cloud @ shares)
        if 1.0 / (shares**2).sum() < threshold * shares.size:
            tooth = uniforms(np.array([key]), 4 * shares.size)[0]
            teeth = (np.arange(shares.size) + tooth) / shares.size
            cloud = cloud[:, np.searchsorted(np.cumsum(shares), teeth, side="right")]
            log_weights, resampled = np.zeros(shares.size), resampled + 1
    return np.array(means), resampled


def moved(cloud, key, drift, root):
    """Eqs. 1-4 on both axes; particle j has the draws 4j to 4j + 3 of the step's key."""
    step, bound, c1, c2 = drift
    draws = uniforms_of(key, 4 * cloud.shape[1]).reshape(-1, 4).T
    result = np.empty_like(cloud)
    for axis in (0, 2):
        radius, angle = np.sqrt(-2.0 * np.log1p(-draws[axis])), 2.0 * np.pi * draws[axis + 1]
        first, second = radius * np.cos(angle), radius * np.sin(angle)
        position, velocity = cloud[axis], cloud[axis + 1]
        pull = np.where(np.abs(position) <= bound, 0.0, c1 * position + c2 * velocity)
        result[axis] = position + step * velocity + root[0] * first
        result[axis + 1] = velocity - step * pull + root[1] * first + root[2] * second
    return result


def uniforms_of(key, count):
    """(count,) the first draws of one key: draw d is the hash of (key, d), which `derive_all` gives as well."""
    return (derive_all(int(key), np.arange(count)) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def problem(particles, steps, sensors=10, seed=0):
    """Truth (steps + 1, 4), and what `run` is given before its keys."""
    rng = np.random.default_rng(seed)
    truth = [np.array([-45.0, -20.0, -50.0, -35.0])]
    keys = derive_all(seed + 900, np.arange(steps))
    for key in keys:
        truth.append(motion.propagate(truth[-1][:, None].copy(), np.array([key]), DRIFT, ROOT)[:, 0])
    truth = np.array(truth)
    positions, gains = rng.uniform(-150.0, 150.0, (sensors, 2)), rng.uniform(0.7, 1.3, sensors)
    squared = np.maximum(((truth[1:, None, [0, 2]] - positions) ** 2).sum(axis=2), 1.0)
    readings = (1.0 + gains * 1e4 * squared**-1.1) * (1.0 + np.sqrt(LAW[3]) * rng.normal(size=(steps, sensors)))
    start = (truth[0] + SD * rng.normal(size=4))[:, None] + SD[:, None] * rng.normal(size=(4, particles))
    return truth, (start, readings, positions, gains, LAW, DRIFT, ROOT, 0.5)


@pytest.mark.thorough
@pytest.mark.parametrize("sensors", [1, 2, 7, 10, 23])
def test_a_run_equals_its_numpy_twin(sensors):
    _, arguments = problem(100, 20, sensors)
    keys = derive_all(5, np.arange(20))
    means, resampled = run(*arguments[:-1], 0.9, keys)
    expected, expected_resampled = run_twin(*arguments[:-1], 0.9, keys)
    assert resampled == expected_resampled > 0
    assert np.allclose(means, expected, rtol=0, atol=1e-9)


def test_without_particles_that_are_resampled_weights_are_kept_over_steps():
    _, arguments = problem(200, 4)
    keys = derive_all(5, np.arange(4))
    means, resampled = run(*arguments[:-1], 0.0, keys)
    assert resampled == 0
    assert np.allclose(means, run_twin(*arguments[:-1], 0.0, keys)[0], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_both_sources_of_noise_give_equally_good_filters():
    """The difference of the two squared errors over 60 data sets, in its standard errors: within 4 of nothing."""
    differences, errors = [], []
    for seed in range(60):
        truth, arguments = problem(60, 8, sensors=3, seed=seed)
        counter, _ = run(*arguments, derive_all(seed, np.arange(8)))
        drawn, _ = run_with_generator(*arguments, np.random.Generator(np.random.Philox(seed)))
        ours, theirs = (((found - truth[1:])[4:, [0, 2]] ** 2).mean() for found in (counter, drawn))
        differences.append(ours - theirs)
        errors.append((ours, theirs))
    assert abs(np.mean(differences)) < 4.0 * np.std(differences) / np.sqrt(60)
    assert np.sqrt(np.median(errors)) < 3.0, "the filters must track, for the comparison to mean anything"


def test_many_particles_find_the_posterior_that_a_grid_gives():
    """One step, velocities known, no process noise: the posterior of the position by summing over a fine grid."""
    rng = np.random.default_rng(3)
    positions, gains = rng.uniform(-40.0, 40.0, (4, 2)), np.ones(4)
    readings = (1.0 + 1e4 * np.maximum(((positions - 2.0) ** 2).sum(axis=1), 1.0) ** -1.1)[None] * 1.01
    sd, law = np.array([2.0, 0.0, 2.0, 0.0])[:, None], (1.0, 1e4, 2.2, 0.02, 0.0)
    start = sd * rng.normal(size=(4, 20_000))
    means, _ = run(start, readings, positions, gains, law, DRIFT, (0.0, 0.0, 0.0), 0.5, derive_all(1, np.arange(1)))
    axis = np.linspace(-10.0, 10.0, 401)
    x, y = (column.ravel() for column in np.meshgrid(axis, axis))
    expected = 1.0 + 1e4 * np.maximum(((np.array([x, y]) - positions[:, :, None]) ** 2).sum(axis=1), 1.0) ** -1.1
    log_post = -(x**2 + y**2) / 8.0 - ((readings.T / expected - 1.0) ** 2 / 0.04 + np.log(expected)).sum(axis=0)
    weights = np.exp(log_post - log_post.max())
    assert means[0, [0, 2]] == pytest.approx([weights @ x / weights.sum(), weights @ y / weights.sum()], abs=0.05)


def test_a_reading_or_a_particle_that_is_no_number_hurts_nobody_else():
    _, arguments = problem(100, 6)
    keys = derive_all(5, np.arange(6))
    start, readings = arguments[0].copy(), arguments[1].copy()
    start[0, 3], start[1, 4], start[2, 5] = np.nan, np.inf, -np.inf
    readings[2, 1] = np.nan
    means, resampled = run(start, readings, *arguments[2:], keys)
    assert np.all(np.isfinite(means)[[0, 1]]) and resampled > 0
    assert np.all(np.isfinite(means[3:])), "after a step without a likely particle the filter goes on"


@njit(**{**OPTIONS, "cache": False})
def logs_and_powers(x, exponent):
    result = np.empty((2, x.size))
    for i in range(x.size):
        result[0, i] = log2(x[i])
        result[1, i] = exp2(exponent * log2(x[i]))
    return result


def test_powers_to_the_base_two_agree_with_the_library():
    x = np.concatenate([10.0 ** np.linspace(-250, 250, 20001), np.linspace(0.5, 2.0, 2001)])
    for exponent in (-1.1, 1.0, 0.3):
        logs, powers = logs_and_powers(x, exponent)
        assert np.allclose(logs, np.log2(x), rtol=1e-15, atol=1e-15)
        assert np.allclose(powers, x**exponent, rtol=1e-12, atol=0.0)
    d = np.linspace(1.0, 1e5, 5001)
    assert np.allclose(logs_and_powers(d, -1.1)[1], d**-1.1, rtol=2e-14, atol=0.0)
    assert np.allclose(logs_and_powers(np.array([1e300, np.inf]), -9.0)[1], 2.0**-1000, rtol=1e-12)
