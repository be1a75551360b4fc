"""The sensors of directions: their geometry and noise by hand, by finite differences and by integration over a turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsnsim.base.arrays import Estimate
from wsnsim.models.acquire import FromReadings
from wsnsim.models.bearing import TURN, Bearing, RangeBearing, wrapped
from wsnsim.models.linear import ConstantVelocity

SENSORS = [Bearing(sd=0.1), Bearing(heading="own", sd=0.02), RangeBearing(), RangeBearing(heading="own")]
MOTION = ConstantVelocity()
PRIOR = Estimate(np.zeros(4), np.eye(4))
rng = np.random.default_rng(5)
POSITIONS, POINTS = rng.uniform(-40.0, 40.0, (5, 2)), rng.uniform(-40.0, 40.0, (2, 30))


def noise_for(sensor, count, generator=rng):
    size = len(sensor.components)
    return generator.standard_normal((count, size) if size > 1 else count)


def readings_of(sensor, point, traits):
    return sensor.measure(np.tile(point, (len(POSITIONS), 1)), POSITIONS, traits, 0.0 * noise_for(sensor, 5))


@pytest.mark.parametrize(
    ("point", "angle"), [((3, 0), 0.0), ((0, 3), math.pi / 2), ((-3, -3), -0.75 * math.pi), ((-3, 1e-9), math.pi)]
)
def test_bearings_are_anticlockwise_from_the_x_axis(point, angle):
    place = np.array([[10.0, -20.0]])
    reading = Bearing().measure(np.array([point]) + place, place, np.empty((1, 0)), np.zeros(1))
    assert reading.shape == (1,) and abs(reading[0]) == pytest.approx(abs(angle), abs=1e-8)
    both = RangeBearing().measure(np.array([point]) + place, place, np.empty((1, 0)), np.zeros((1, 2)))
    assert both[0, 0] == pytest.approx(math.hypot(*point)) and both[0, 1] == reading[0]


def test_a_node_with_a_heading_of_its_own_measures_from_there():
    place, heading = np.zeros((1, 2)), np.array([[3.0]])
    reading = Bearing(heading="own").measure(np.array([[-1.0, -1.0]]), place, heading, np.zeros(1))
    assert reading[0] == pytest.approx(-0.75 * math.pi - 3.0 + TURN)
    headings = Bearing(heading="own").draw_traits(2000, np.random.default_rng(1))
    assert headings.min() < -3.0 and headings.max() > 3.0 and abs(headings.mean()) < 0.2
    assert Bearing(heading="own").trait_names == ("heading",) and Bearing().draw_traits(3, rng).shape == (3, 0)


def test_readings_stay_within_half_a_turn_and_have_the_deviations():
    sensor, generator = RangeBearing(range_sd=2.0, bearing_sd=0.1), np.random.default_rng(3)
    points = np.tile([-20.0, 0.0], (4000, 1))
    found = sensor.measure(points, np.zeros((4000, 2)), np.empty((4000, 0)), noise_for(sensor, 4000, generator))
    assert np.abs(found[:, 1]).max() <= math.pi and (found[:, 1] < 0).mean() == pytest.approx(0.5, abs=0.03)
    apart = wrapped(found[:, 1] - math.pi)
    assert found[:, 0].std() == pytest.approx(2.0, rel=0.05) and apart.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(found[:, 0], apart)[0, 1]) < 0.05


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_gradients_are_those_of_finite_differences(sensor):
    traits = sensor.draw_traits(5, np.random.default_rng(2))
    means, gradients, variances = sensor.linearise(POINTS, POSITIONS, traits)
    rows = 5 * len(sensor.components)
    assert means.shape == variances.shape == (rows, 30) and gradients.shape == (rows, 2, 30)
    for axis in range(2):
        step = np.zeros((2, 1))
        step[axis] = 1e-6
        apart = [sensor.linearise(POINTS + sign * step, POSITIONS, traits)[0] for sign in (1, -1)]
        np.testing.assert_allclose(wrapped(apart[0] - apart[1]) / 2e-6, gradients[:, axis], atol=1e-6)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_the_expected_rows_are_readings_without_noise_node_by_node(sensor):
    traits = sensor.draw_traits(5, np.random.default_rng(2))
    means = sensor.linearise(POINTS[:, :1], POSITIONS, traits)[0]
    np.testing.assert_allclose(means[:, 0], readings_of(sensor, POINTS[:, 0], traits).reshape(-1))


def test_the_density_of_a_bearing_integrates_to_one_over_a_turn_at_the_largest_deviation():
    sensor = Bearing(sd=0.5)
    angles = np.linspace(-math.pi, math.pi, 20_001)[:-1]
    point, place = np.array([[-30.0], [1.0]]), np.zeros((1, 2))
    logs = [sensor.log_likelihood(point, np.array([z]), place, np.empty((1, 0)))[0] for z in angles[::20]]
    assert np.exp(logs).mean() * TURN == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_log_likelihoods_are_sums_of_normal_densities_of_shortest_differences(sensor):
    traits = sensor.draw_traits(5, np.random.default_rng(2))
    points = np.tile(POINTS[:, :1].T, (5, 1))
    readings = sensor.measure(points, POSITIONS, traits, noise_for(sensor, 5))
    means, _, variances = sensor.linearise(POINTS, POSITIONS, traits)
    apart = readings.reshape(-1)[:, None] - means
    last = np.arange(len(apart)) % len(sensor.components) == len(sensor.components) - 1
    apart[last] = (apart[last] + math.pi) % TURN - math.pi
    each = -0.5 * (apart**2 / variances + np.log(TURN * variances))
    joint = sensor.log_likelihood(POINTS, readings, POSITIONS, traits)
    np.testing.assert_allclose(joint, each.sum(axis=0))
    owners = np.arange(30) % 5
    own = sensor.log_likelihood(POINTS, readings, POSITIONS, traits, owners)
    by_node = each.reshape(5, -1, 30).sum(axis=1)
    np.testing.assert_allclose(own, by_node[owners, np.arange(30)])
    later = readings + TURN * np.array(sensor.periods) / TURN if readings.ndim > 1 else readings + TURN
    np.testing.assert_allclose(sensor.log_likelihood(POINTS, later, POSITIONS, traits), joint)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_what_is_not_finite_has_no_likelihood_and_no_slope(sensor):
    traits = sensor.draw_traits(5, np.random.default_rng(2))
    readings = readings_of(sensor, POINTS[:, 0], traits)
    lost = np.array([[np.inf, np.nan, 1.0], [0.0, 0.0, 1.0]])
    logs = sensor.log_likelihood(lost, readings, POSITIONS, traits)
    assert logs[0] == logs[1] == -np.inf and np.isfinite(logs[2])
    assert np.isfinite(sensor.linearise(lost, POSITIONS, traits)[1]).all()
    assert sensor.log_likelihood(POINTS, readings * np.nan, POSITIONS, traits).max() == -np.inf
    nothing = sensor.log_likelihood(POINTS, readings[:0], POSITIONS[:0], traits[:0])
    assert (nothing == 0.0).all() and nothing.shape == (30,)


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_information_is_the_covariance_of_the_score_of_sampled_readings(sensor):
    traits, point = sensor.draw_traits(5, np.random.default_rng(2)), POINTS[:, :1]
    generator, scores = np.random.default_rng(7), []
    step = 1e-5 * np.array([[[1.0], [0.0]], [[0.0], [1.0]]])
    for _ in range(1500):
        readings = sensor.measure(np.tile(point.T, (5, 1)), POSITIONS, traits, noise_for(sensor, 5, generator))
        around = np.hstack([point + step[0], point - step[0], point + step[1], point - step[1]])
        logs = sensor.log_likelihood(around, readings, POSITIONS, traits)
        scores.append([(logs[0] - logs[1]) / 2e-5, (logs[2] - logs[3]) / 2e-5])
    exact = sensor.information(point, POSITIONS, traits)[..., 0].sum(axis=0)
    sampled = np.cov(np.array(scores).T)
    assert np.abs(sampled - exact).max() < 0.15 * np.trace(exact)
    assert np.abs(np.mean(scores, axis=0)).max() < 5.0 * math.sqrt(np.trace(exact) / 1500)


def test_a_node_detects_between_its_least_distance_and_its_range_and_slopes_are_bounded_below():
    sensor = Bearing(reach=10.0, least=2.0)
    points = np.array([[1.99, 0.0], [2.0, 0.0], [10.0, 0.0], [10.01, 0.0]])
    assert sensor.detects(points, np.zeros((1, 2)))[:, 0].tolist() == [False, True, True, False]
    near = np.array([[0.0, 0.5, 2.0], [0.0, 0.0, 0.0]])
    slopes = sensor.linearise(near, np.zeros((1, 2)), np.empty((1, 0)))[1]
    np.testing.assert_allclose(slopes[0], [[0.0, 0.0, 0.0], [0.0, 0.125, 0.5]], atol=1e-15)


def test_a_bearing_has_no_strength_and_a_range_with_a_bearing_has_that_of_the_range():
    assert Bearing().strength(0.1) == Bearing().strength(3.0)
    assert RangeBearing().strength((5.0, 0.1)) > RangeBearing().strength((6.0, 3.0))


def initiated(sensor, target, places):
    places = np.array(places, dtype=float)
    traits = np.empty((len(places), 0))
    noise = np.zeros((len(places), len(sensor.components))).squeeze(axis=1 if len(sensor.components) == 1 else ())
    readings = sensor.measure(np.tile(target, (len(places), 1)), places, traits, noise)
    estimate = FromReadings().estimate(readings, places, traits, sensor, MOTION, PRIOR)
    rows = list(MOTION.position)
    return estimate.mean[rows], estimate.cov[np.ix_(rows, rows)]


def test_one_bearing_initiates_a_track_in_a_wedge_and_two_where_they_cross():
    sensor = Bearing(sd=0.02, reach=60.0)
    mean, cov = initiated(sensor, (-40.0, 0.5), [(0.0, 0.0)])
    along, across = np.sqrt(np.diag(cov))
    assert abs(mean[1]) < 2.0 and mean[0] < -20.0 and along > 5.0 * across
    crossing, spread = initiated(sensor, (-40.0, 0.5), [(0.0, 0.0), (-40.0, 40.0)])
    np.testing.assert_allclose(crossing, [-40.0, 0.5], atol=1.0)
    assert np.sqrt(np.trace(spread)) < 3.0


def test_one_range_with_a_bearing_initiates_a_track_at_a_point():
    mean, cov = initiated(RangeBearing(range_sd=1.0, bearing_sd=0.02), (-40.0, 0.5), [(0.0, 0.0)])
    np.testing.assert_allclose(mean, [-40.0, 0.5], atol=0.5)
    assert np.sqrt(np.trace(cov)) < 3.0


def test_bearings_of_a_target_on_a_line_have_one_slope():
    sensor = RangeBearing()
    points = np.array([[-5.0, 7.0]])
    means, gradients, _ = sensor.linearise(points, np.array([[0.0, 3.0]]), np.empty((1, 0)))
    np.testing.assert_allclose(means[1], np.arctan2(-3.0, points[0]))
    np.testing.assert_allclose(gradients[1, 0], 3.0 / (points[0] ** 2 + 9.0))
    assert sensor.information(points, np.array([[0.0, 3.0]]), np.empty((1, 0))).shape == (1, 1, 1, 2)
