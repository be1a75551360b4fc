"""The sensing kernels against plain NumPy and SciPy's normal density."""

import numpy as np
import pytest
from scipy.stats import norm

from wsnsim.kernels import acoustic

PARTICLES, SENSORS = 400, 18


def setup(inflation):
    draw = np.random.default_rng(4)
    points = draw.normal(0.0, 15.0, (2, PARTICLES))
    positions = draw.uniform(-60.0, 60.0, (SENSORS, 2))
    points[:, 0] = positions[3]
    points[:, 1] = positions[3] + 0.4
    gains = draw.uniform(0.7, 1.3, SENSORS)
    law = (1.0, 1e4, 2.2, 0.003, inflation)
    mean, variance = twin(points, positions, gains, law)
    readings = mean[:, 5] + np.sqrt(variance[:, 5]) * draw.standard_normal(SENSORS)
    return points, positions, gains, law, readings


def twin(points, positions, gains, law):
    noise, intensity, decay, spread, inflation = law
    apart = points[None, :, :] - positions[:, :, None]
    signal = intensity * np.maximum(np.hypot(apart[:, 0], apart[:, 1]), 1.0) ** -decay
    mean = noise + gains[:, None] * signal
    return mean, spread * mean**2 + inflation * signal**2


def relative(a, b):
    return np.max(np.abs(a - b) / np.maximum(1.0, np.abs(b)))


@pytest.mark.parametrize("inflation", [0.0, 0.03])
def test_the_joint_likelihood_is_the_sum_of_normal_log_densities(inflation):
    points, positions, gains, law, readings = setup(inflation)
    mean, variance = twin(points, positions, gains, law)
    truth = norm.logpdf(readings[:, None], mean, np.sqrt(variance)).sum(axis=0)
    found = acoustic.joint_log_likelihood(*points, readings, positions, gains, law)
    assert relative(found, truth) < 1e-9


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 8, 9])
def test_any_number_of_readings_is_summed_whole(count):
    points, positions, gains, law, readings = setup(0.0)
    mean, variance = twin(points, positions[:count], gains[:count], law)
    truth = norm.logpdf(readings[:count, None], mean, np.sqrt(variance)).sum(axis=0)
    found = acoustic.joint_log_likelihood(*points, readings[:count], positions[:count], gains[:count], law)
    assert relative(found, truth) < 1e-9


@pytest.mark.parametrize("inflation", [0.0, 0.03])
def test_a_particle_is_weighed_with_its_owners_reading_alone(inflation):
    points, positions, gains, law, readings = setup(inflation)
    owners = np.random.default_rng(5).integers(0, SENSORS, PARTICLES)
    mean, variance = twin(points, positions, gains, law)
    own = (owners, np.arange(PARTICLES))
    truth = norm.logpdf(readings[owners], mean[own], np.sqrt(variance[own]))
    found = acoustic.own_log_likelihood(*points, readings, positions, gains, owners, law)
    assert relative(found, truth) < 1e-9


def test_an_owner_without_a_reading_is_refused():
    points, positions, gains, law, readings = setup(0.0)
    for stranger in (-1, SENSORS):
        owners = np.full(PARTICLES, stranger)
        with pytest.raises(IndexError, match="not there"):
            acoustic.own_log_likelihood(*points, readings, positions, gains, owners, law)


def test_what_is_not_finite_is_impossible_and_hurts_nobody_else():
    points, positions, gains, law, readings = setup(0.0)
    owners = np.arange(PARTICLES) % SENSORS
    clean = acoustic.joint_log_likelihood(*points, readings, positions, gains, law)
    own = acoustic.own_log_likelihood(*points, readings, positions, gains, owners, law)
    points[0, 10], points[1, 11], points[0, 12] = np.nan, np.inf, -np.inf
    points[:, 13] = 1e300
    for found, before in (
        (acoustic.joint_log_likelihood(*points, readings, positions, gains, law), clean),
        (acoustic.own_log_likelihood(*points, readings, positions, gains, owners, law), own),
    ):
        assert np.all(np.isneginf(found[10:13]))
        assert not np.any(np.isnan(found))
        untouched = np.setdiff1d(np.arange(PARTICLES), [10, 11, 12, 13])
        assert np.array_equal(found[untouched], before[untouched])


def test_a_reading_that_is_no_number_makes_every_point_impossible():
    points, positions, gains, law, readings = setup(0.0)
    readings[2] = np.nan
    assert np.all(np.isneginf(acoustic.joint_log_likelihood(*points, readings, positions, gains, law)))


@pytest.mark.parametrize("inflation", [0.0, 0.03])
def test_linearisation_gives_mean_variance_and_the_slope_of_finite_differences(inflation):
    points, positions, gains, law, _ = setup(inflation)
    mean, variance = twin(points, positions, gains, law)
    means, gradients, variances = acoustic.linearised(*points, positions, gains, law)
    assert relative(means, mean) < 1e-9
    assert relative(variances, variance) < 1e-9
    step = 1e-5
    for axis in range(2):
        shift = np.zeros((2, 1))
        shift[axis] = step
        slope = (twin(points + shift, positions, gains, law)[0] - twin(points - shift, positions, gains, law)[0]) / (
            2 * step
        )
        assert np.allclose(gradients[:, axis], slope, rtol=1e-4, atol=1e-4)


def test_linearisation_within_a_metre_is_flat_and_at_infinity_silent():
    points, positions, gains, law, _ = setup(0.0)
    points[:, 20], points[0, 21] = np.nan, np.inf
    means, gradients, variances = acoustic.linearised(*points, positions, gains, law)
    assert np.all(gradients[3, :, :2] == 0.0)
    assert np.all(means[:, 20:22] == 1.0)
    assert np.all(gradients[:, :, 20:22] == 0.0)
    assert np.all(np.isfinite(variances))
