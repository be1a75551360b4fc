"""The sensor of a coordinate: linear, with the likelihood and information of a Gaussian."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.models.linear_sensing import Coordinate

RNG = np.random.default_rng(1)
SENSOR = Coordinate(sd=0.5)
POSITIONS = RNG.normal(size=(3, 2))
THETA = np.array([[0.0], [np.pi / 2], [0.7]])


@pytest.mark.parametrize("columns", (1, 2))
def test_readings_are_linear_and_their_gradients_are_the_axes(columns):
    points = RNG.normal(size=(columns, 5))
    expected, gradients, variances = SENSOR.linearise(points, POSITIONS, THETA)
    exact = np.repeat(points.T, 3, axis=0)
    noiseless = SENSOR.measure(exact, np.tile(POSITIONS, (5, 1)), np.tile(THETA, (5, 1)), np.zeros(15))
    assert np.allclose(expected.T.ravel(), noiseless)
    assert np.allclose((gradients * points).sum(axis=1), expected) and gradients.shape == (3, columns, 5)
    assert (variances == 0.25).all()
    assert np.allclose(SENSOR.information(points, POSITIONS, THETA)[0, 0, 0], 4.0)


def test_the_likelihood_is_the_normal_density_of_all_readings_or_of_each_particles_own():
    points, readings = RNG.normal(size=(2, 4)), RNG.normal(size=3)
    expected = SENSOR.linearise(points, POSITIONS, THETA)[0]
    logs = -0.5 * ((readings[:, None] - expected) / 0.5) ** 2 - np.log(0.5 * np.sqrt(2 * np.pi))
    assert np.allclose(SENSOR.log_likelihood(points, readings, POSITIONS, THETA), logs.sum(axis=0))
    owners = np.array([0, 2, 1, 1])
    own = SENSOR.log_likelihood(points, readings, POSITIONS, THETA, owners)
    assert np.allclose(own, logs[owners, np.arange(4)])
    assert (SENSOR.log_likelihood(points, np.empty(0), POSITIONS[:0], THETA[:0]) == 0.0).all()
    assert SENSOR.log_likelihood(np.array([[np.inf], [0.0]]), readings, POSITIONS, THETA)[0] == -np.inf


def test_axes_are_uniform_over_half_a_turn():
    theta = SENSOR.draw_traits(10_000, np.random.default_rng(2))[:, 0]
    assert theta.min() >= 0.0 and theta.max() < np.pi and abs(theta.mean() - np.pi / 2) < 0.04
