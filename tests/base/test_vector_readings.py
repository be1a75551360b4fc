"""Rows of readings of several components, and angles near what is expected."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsnsim.base.vector_readings import components_of, is_finite, near, periods_of, rows

TURN = 2.0 * math.pi


class Scalar:
    """A sensor model without the port."""


class Compass:
    components = ("bearing",)
    periods = (TURN,)


class Radar:
    components = ("range", "bearing")
    periods = (0.0, TURN)


def test_a_sensor_model_without_the_port_has_one_component_without_a_period():
    assert (components_of(Scalar()), periods_of(Scalar())) == (("reading",), (0.0,))
    readings = np.array([1.0, 2.0])
    assert rows(Scalar(), readings).tolist() == [1.0, 2.0]
    assert near(Scalar(), readings, readings + 100.0) is readings


def test_rows_are_the_components_node_by_node():
    assert rows(Radar(), np.array([[1.0, 2.0], [3.0, 4.0]])).tolist() == [1.0, 2.0, 3.0, 4.0]
    assert rows(Compass(), np.array([1.0, 2.0])).tolist() == [1.0, 2.0]
    assert rows(Radar(), np.empty((0, 2))).tolist() == []


@pytest.mark.parametrize(("sensor", "shape"), [(Radar(), (2,)), (Radar(), (2, 3)), (Compass(), (2, 1))])
def test_rows_of_another_shape_are_refused(sensor, shape):
    with pytest.raises(ValueError, match="components per node expected"):
        rows(sensor, np.zeros(shape))


def test_an_angle_is_moved_by_whole_turns_to_less_than_half_a_turn_of_what_is_expected():
    expected = np.random.default_rng(1).uniform(-20.0, 20.0, (8, 5))
    measured = np.random.default_rng(2).uniform(-3.0, 3.0, (8, 1))
    moved = near(Compass(), measured, expected)
    assert np.all(np.abs(moved - expected) <= math.pi + 1e-12)
    turns = (moved - measured) / TURN
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    assert moved.shape == (8, 5)


def test_only_components_with_a_period_are_moved():
    measured, expected = np.array([10.0, 3.0, 20.0, -3.0]), np.array([100.0, -3.0, 0.0, 3.0])
    moved = near(Radar(), measured, expected)
    np.testing.assert_allclose(moved, [10.0, 3.0 - TURN, 20.0, -3.0 + TURN])
    np.testing.assert_array_equal(near(Radar(), measured[:, None], expected[:, None])[:, 0], moved)


def test_a_reading_is_finite_if_all_of_its_components_are():
    assert is_finite(1.0) and is_finite((1.0, 2.0))
    assert not is_finite(math.nan) and not is_finite((1.0, math.inf))
