"""The acoustic-energy sensor and the coordinate sensor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from wsnsim.models.sensing import AcousticEnergy, Coordinate

SENSOR = AcousticEnergy()


def moments(distances, gains, extra=0.0):
    signal = 1e4 * np.maximum(distances, 1.0) ** -2.2
    mean = 1.0 + gains * signal
    return mean, 2 * 1.5 / 1000 * mean**2 + extra * signal**2


def scene(count=7):
    draw = np.random.default_rng(8)
    positions, traits = draw.uniform(-50, 50, (count, 2)), SENSOR.draw_traits(count, draw)
    points = draw.uniform(-50, 50, (2, 30))
    distances = np.hypot(points[0] - positions[:, :1], points[1] - positions[:, 1:])
    readings = SENSOR.measure(np.zeros((count, 2)), positions, traits, draw.standard_normal(count))
    return points, readings, positions, traits, distances


def test_signal_and_noise_are_about_equal_at_the_edge_of_the_reach():
    assert 0.5 < moments(np.array([60.0]), 1.0)[0][0] - 1.0 < 2.0


def test_readings_have_the_mean_and_the_variance_of_the_equations():
    count = 100_000
    points, positions = np.tile([20.0, 0.0], (count, 1)), np.zeros((count, 2))
    traits, normals = np.full((count, 1), 1.2), np.random.default_rng(2).standard_normal(count)
    readings = SENSOR.measure(points, positions, traits, normals)
    mean, variance = moments(20.0, 1.2)
    assert readings.mean() == pytest.approx(mean, rel=1e-3)
    assert readings.var() == pytest.approx(variance, rel=0.02)


def test_no_distance_counts_as_less_than_a_metre():
    at = SENSOR.measure(np.array([[0.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)), np.ones((2, 1)), np.zeros(2))
    assert at[0] == at[1] == pytest.approx(10_001.0)


def test_gains_are_uniform_about_one():
    gains = SENSOR.draw_traits(20_000, np.random.default_rng(1))
    assert gains.shape == (20_000, 1)
    assert gains.min() >= 0.7
    assert gains.max() <= 1.3
    assert gains.mean() == pytest.approx(1.0, abs=0.005)
    assert gains.var() == pytest.approx(0.03, rel=0.03)


def test_the_likelihood_of_all_readings_is_a_product_of_normals():
    points, readings, positions, traits, distances = scene()
    mean, variance = moments(distances, traits)
    truth = norm.logpdf(readings[:, None], mean, np.sqrt(variance)).sum(axis=0)
    assert np.allclose(SENSOR.log_likelihood(points, readings, positions, traits), truth, rtol=1e-10)


def test_the_likelihood_of_a_particles_own_reading_is_one_normal():
    points, readings, positions, traits, distances = scene()
    owners = np.arange(30) % 7
    mean, variance = moments(distances, traits)
    truth = norm.logpdf(readings[owners], mean[owners, range(30)], np.sqrt(variance[owners, range(30)]))
    assert np.allclose(SENSOR.log_likelihood(points, readings, positions, traits, owners), truth, rtol=1e-10)


def test_without_readings_nothing_is_learnt():
    points, *_ = scene()
    nothing = SENSOR.log_likelihood(points, np.empty(0), np.empty((0, 2)), np.empty((0, 1)))
    assert np.array_equal(nothing, np.zeros(30))


def test_points_that_are_not_finite_are_impossible():
    points, readings, positions, traits, _ = scene()
    points[0, 0], points[1, 1] = np.nan, np.inf
    for owners in (None, np.arange(30) % 7):
        found = SENSOR.log_likelihood(points, readings, positions, traits, owners)
        assert np.all(np.isneginf(found[:2]))
        assert np.all(np.isfinite(found[2:]))


def test_slopes_are_those_of_finite_differences():
    points, _, positions, traits, _ = scene()
    _, gradients, _ = SENSOR.linearise(points, positions, traits)
    for axis in range(2):
        shift = np.zeros((2, 1))
        shift[axis] = 1e-5
        above, below = (SENSOR.linearise(points + s, positions, traits)[0] for s in (shift, -shift))
        assert np.allclose(gradients[:, axis], (above - below) / 2e-5, rtol=1e-5, atol=1e-5)


def test_a_filter_that_knows_the_gains_believes_the_truth():
    assert SENSOR.assumed("known", inflate=False) is SENSOR


@pytest.mark.parametrize(("inflate", "extra"), [(False, 0.0), (True, 0.03)])
def test_a_filter_that_does_not_know_the_gains_takes_them_as_one(inflate, extra):
    points, readings, positions, traits, distances = scene()
    belief = SENSOR.assumed("unknown", inflate)
    mean, variance = moments(distances, 1.0, extra)
    truth = norm.logpdf(readings[:, None], mean, np.sqrt(variance)).sum(axis=0)
    assert np.allclose(belief.log_likelihood(points, readings, positions, traits), truth, rtol=1e-10)
    means, _, variances = belief.linearise(points, positions, traits)
    assert np.allclose(means, mean, rtol=1e-10)
    assert np.allclose(variances, variance, rtol=1e-10)
    assert belief.reach == SENSOR.reach
    assert belief.assumed("known", inflate=False) is SENSOR


def test_the_inflation_is_the_variance_of_the_gain():
    """R' must be the variance of g I d^-α + noise over both gains and noise, to first order in the noise."""
    draw, count = np.random.default_rng(3), 200_000
    sensor = AcousticEnergy(samples=10**9)
    readings = sensor.measure(
        np.tile([10.0, 0.0], (count, 1)),
        np.zeros((count, 2)),
        sensor.draw_traits(count, draw),
        draw.standard_normal(count),
    )
    _, _, variances = sensor.assumed("unknown", inflate=True).linearise(
        np.array([[10.0], [0.0]]), np.zeros((1, 2)), np.ones((1, 1))
    )
    assert readings.var() == pytest.approx(variances[0, 0], rel=0.02)


def test_what_the_belief_measures_is_what_it_believes():
    belief, count = SENSOR.assumed("unknown", inflate=True), 800
    normals = np.random.default_rng(4).standard_normal(count)
    readings = belief.measure(np.tile([10.0, 0.0], (count, 1)), np.zeros((count, 2)), np.full((count, 1), 1.3), normals)
    mean, variance = moments(10.0, 1.0, 0.03)
    assert np.allclose(readings, mean + np.sqrt(variance) * normals, rtol=1e-10)
    assert np.array_equal(belief.draw_traits(3, np.random.default_rng(1)), np.ones((3, 1)))


BELIEFS = {
    "known gains": SENSOR,
    "unknown gains": SENSOR.assumed("unknown", inflate=False),
    "inflated": SENSOR.assumed("unknown", inflate=True),
    "few samples": AcousticEnergy(samples=2),
}
each_belief = pytest.mark.parametrize("sensor", BELIEFS.values(), ids=BELIEFS.keys())


@each_belief
@pytest.mark.parametrize("columns", [1, 2])
def test_information_is_the_covariance_of_the_score(sensor, columns):
    """The score by central differences, over 40 000 readings: four standard deviations of its mean square, 3 %."""
    count, step, gain = 40_000, 1e-4, 1.0 if sensor in (BELIEFS["unknown gains"], BELIEFS["inflated"]) else 1.2
    node, point = np.array([2.0, -5.0]), np.array([9.0, 3.0])[:columns]
    places, traits = np.tile(node, (count, 1)), np.full((count, 1), gain)
    means, _, variances = sensor.linearise(point[:, None], places[:1], traits[:1])
    readings = means[0, 0] + np.sqrt(variances[0, 0]) * np.random.default_rng(6).standard_normal(count)
    scores = np.empty((columns, count))
    for axis in range(columns):
        shift = step * (np.arange(columns) == axis)[:, None]
        above, below = (
            sensor.log_likelihood(np.tile(point[:, None] + d, count), readings, places, traits, np.arange(count))
            for d in (shift, -shift)
        )
        scores[axis] = (above - below) / (2 * step)
    covariance = scores @ scores.T / count
    found = sensor.information(point[:, None], places[:1], traits[:1])
    assert found.shape == (1, columns, columns, 1)
    assert np.abs(found[0, :, :, 0] - covariance).max() <= 0.03 * np.trace(covariance)


def test_where_the_variance_grows_with_the_square_of_the_mean_it_tells_as_much_as_two_more_spreads():
    """R = ε μ² gives (∂μ)²/R + (2 ∂μ/μ)²/2 = (∂μ)² (1/ε + 2)/μ², here with ε = 2c/N_sam = 1.5."""
    sensor, point = AcousticEnergy(samples=2), np.array([[6.0], [8.0]])
    mean, _ = moments(10.0, 1.1)
    slope = -2.2 * 1.1 * 1e4 * 10.0**-3.2 * np.array([0.6, 0.8])
    found = sensor.information(point, np.zeros((1, 2)), np.full((1, 1), 1.1))[0, :, :, 0]
    assert np.allclose(found, np.outer(slope, slope) * (1 / 1.5 + 2) / mean**2, rtol=1e-10)


@each_belief
def test_a_target_on_the_x_axis_is_one_in_the_plane_with_y_zero(sensor):
    points, readings, positions, traits, _ = scene()
    line, plane = points[:1], np.stack([points[0], np.zeros(30)])
    owners = np.arange(30) % 7
    for given in ((), (owners,)):
        assert np.array_equal(
            sensor.log_likelihood(line, readings, positions, traits, *given),
            sensor.log_likelihood(plane, readings, positions, traits, *given),
        )
    flat, full = (sensor.linearise(where, positions, traits) for where in (line, plane))
    assert np.array_equal(flat[0], full[0])
    assert np.array_equal(flat[1], full[1][:, :1])
    assert np.array_equal(flat[2], full[2])
    assert np.allclose(
        sensor.information(line, positions, traits), sensor.information(plane, positions, traits)[:, :1, :1], rtol=1e-12
    )
    normals = np.zeros(7)
    assert np.array_equal(
        sensor.measure(line.T[:7], positions, traits, normals), sensor.measure(plane.T[:7], positions, traits, normals)
    )


RNG = np.random.default_rng(1)
COORDINATE = Coordinate(sd=0.5)
POSITIONS = RNG.normal(size=(3, 2))
THETA = np.array([[0.0], [np.pi / 2], [0.7]])


@pytest.mark.parametrize("columns", (1, 2))
def test_readings_are_linear_and_their_gradients_are_the_axes(columns):
    points = RNG.normal(size=(columns, 5))
    expected, gradients, variances = COORDINATE.linearise(points, POSITIONS, THETA)
    exact = np.repeat(points.T, 3, axis=0)
    noiseless = COORDINATE.measure(exact, np.tile(POSITIONS, (5, 1)), np.tile(THETA, (5, 1)), np.zeros(15))
    assert np.allclose(expected.T.ravel(), noiseless)
    assert np.allclose((gradients * points).sum(axis=1), expected) and gradients.shape == (3, columns, 5)
    assert (variances == 0.25).all()
    assert np.allclose(COORDINATE.information(points, POSITIONS, THETA)[0, 0, 0], 4.0)


def test_the_likelihood_is_the_normal_density_of_all_readings_or_of_each_particles_own():
    points, readings = RNG.normal(size=(2, 4)), RNG.normal(size=3)
    expected = COORDINATE.linearise(points, POSITIONS, THETA)[0]
    logs = -0.5 * ((readings[:, None] - expected) / 0.5) ** 2 - np.log(0.5 * np.sqrt(2 * np.pi))
    assert np.allclose(COORDINATE.log_likelihood(points, readings, POSITIONS, THETA), logs.sum(axis=0))
    owners = np.array([0, 2, 1, 1])
    own = COORDINATE.log_likelihood(points, readings, POSITIONS, THETA, owners)
    assert np.allclose(own, logs[owners, np.arange(4)])
    assert (COORDINATE.log_likelihood(points, np.empty(0), POSITIONS[:0], THETA[:0]) == 0.0).all()
    assert COORDINATE.log_likelihood(np.array([[np.inf], [0.0]]), readings, POSITIONS, THETA)[0] == -np.inf


def test_axes_are_uniform_over_half_a_turn():
    theta = COORDINATE.draw_traits(10_000, np.random.default_rng(2))[:, 0]
    assert theta.min() >= 0.0 and theta.max() < np.pi and abs(theta.mean() - np.pi / 2) < 0.04
