"""Rows of readings of several components, and angles near what is expected."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsnsim.base.arrays import components_of, is_finite, means, near, periods_of, rows
from wsnsim.scenario.registry import ROLES, load_class

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


def _with_angles() -> list[Any]:
    """Every shipped sensor model with an angle that can be made without parameters."""
    classes = [load_class(info) for info in ROLES["sensor"].kinds]
    return [made() for made in classes if any(getattr(made, "periods", ()))]


@pytest.mark.parametrize("sensor", _with_angles(), ids=repr)
@settings(max_examples=20)
@given(data=st.data())
def test_of_several_readings_angles_are_combined_on_the_circle(sensor: Any, data: st.DataObject) -> None:
    """Readings within a quarter of a turn around a place: their mean turns with them, in any order, by whole turns."""
    periods = np.array(periods_of(sensor))
    count, size = data.draw(st.integers(1, 5)), len(periods)
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    off, place = rng.uniform(-0.25, 0.25, (count, size)), rng.uniform(-1.0, 1.0, size)
    scale = np.where(periods > 0.0, periods, 1.0)
    groups = np.zeros(count, dtype=np.int64)

    def mean(shares: Any) -> Any:
        readings = shares * scale
        found = means(sensor, readings if size > 1 else readings[:, 0], groups, 2)
        assert np.isnan(found[1]).all(), "a group without a reading has none"
        return np.atleast_1d(found[0]) / scale

    turns = rng.integers(-1, 2, (count, size)) * (periods > 0.0)
    middle = mean(off)
    apart = mean(rng.permutation(off + place + turns)) - place - middle
    np.testing.assert_allclose(np.where(periods > 0.0, apart - np.round(apart), apart), 0.0, atol=1e-12)
    plain = off.mean(axis=0)
    angles = np.arctan2(np.sin(math.tau * off).sum(axis=0), np.cos(math.tau * off).sum(axis=0)) / math.tau
    np.testing.assert_allclose(middle, np.where(periods > 0.0, angles, plain), atol=1e-12)


def test_there_are_sensors_with_angles_and_opposite_ones_have_no_mean() -> None:
    assert {type(sensor).__name__ for sensor in _with_angles()} >= {"Bearing", "RangeBearing"}
    opposite = np.array([0.3, 0.3 + math.pi, 1.0])
    found = means(_with_angles()[0], opposite, np.array([0, 0, 1]), 2)
    assert found.tolist() == [0.3, 1.0], "the first one stands, and one alone is as it is"
