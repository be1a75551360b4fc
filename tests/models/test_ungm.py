"""The growth model and its squared reading: by hand, by finite differences, by numerical integration."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import create_model
from scipy.integrate import trapezoid
from scipy.stats import kstest, norm

from wsnsim.base.errors import RunError
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.rng import derive_all
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.scenario.fields import fields_of

MODEL: MotionModel = Ungm()
SENSOR: SensorModel = Squared()
LARGEST_STATE, ALIKE = np.zeros((1, 2)), np.empty((1, 0))


def some_states(count: int = 40) -> np.ndarray:
    return np.random.default_rng(6).normal(0.0, 12.0, (1, count))


def test_the_first_steps_are_those_reckoned_by_hand() -> None:
    """u = 1 is pushed by 8 cos 0 = 8, u = 2 by 8 cos 1.2 = 2.898862, u = 11 by 8 cos 12 = 6.750832."""
    x = np.array([[2.0]])
    for step, push in ((0, 8.0), (1, 2.898862), (10, 6.750832)):
        assert MODEL.advance(x, 1.0, float(step))[0, 0] == pytest.approx(11.0 + push, abs=1e-6)
        assert MODEL.advance(x, 0.25, float(step))[0, 0] == pytest.approx(11.0 + push, abs=1e-6)


def test_the_derivative_is_that_of_finite_differences() -> None:
    states = np.concatenate([some_states(), [[0.0, 1.0, -1.0, 1e3]]], axis=1)
    slopes, noise = Ungm(q=10.0).matrices(states, 1.0, 3.0)
    h = 1e-5
    found = (MODEL.advance(states + h, 1.0, 3.0) - MODEL.advance(states - h, 1.0, 3.0)) / (2 * h)
    assert slopes.shape == (44, 1, 1)
    assert np.allclose(slopes[:, 0, 0], found[0], atol=1e-6)
    assert noise.tolist() == [[10.0]]


def test_far_from_the_origin_the_derivative_is_a_half() -> None:
    far = np.array([[1e100, -1e200, np.inf]])
    assert np.array_equal(MODEL.matrices(far, 1.0, 0.0)[0][:, 0, 0], [0.5, 0.5, 0.5])


def test_the_noise_of_many_particles_is_normal_with_the_variance() -> None:
    """100 000 draws, and Kolmogorov's test."""
    model, states = Ungm(q=10.0), np.full((1, 100_000), 3.0)
    moved = model.propagate(states, 1.0, derive_all(9, np.arange(100_000)), 5.0)
    centre = 1.5 + 25 * 3 / 10 + 8 * np.cos(6.0)
    assert kstest(moved[0], norm(centre, np.sqrt(10.0)).cdf).pvalue > 0.01


def test_equal_keys_move_alike_in_any_order() -> None:
    states, keys, order = some_states(), derive_all(9, np.arange(40)), np.random.default_rng(1).permutation(40)
    moved = MODEL.propagate(states, 1.0, keys, 2.0)
    again = MODEL.propagate(states[:, order], 1.0, keys[order], 2.0)
    assert np.allclose(again, moved[:, order], rtol=1e-13, atol=1e-13)
    assert np.allclose(MODEL.propagate(states[:, 5:9], 1.0, keys[5:9], 2.0), moved[:, 5:9], rtol=1e-13, atol=1e-13)


def test_the_transition_density_is_the_normal_and_integrates_to_one() -> None:
    after, before = np.linspace(-60.0, 60.0, 20_001)[None], np.full((1, 20_001), 3.0)
    found = Ungm(q=10.0).log_transition(after, before, 1.0, 5.0)
    assert np.allclose(found, norm(9.0 + 8 * np.cos(6.0), np.sqrt(10.0)).logpdf(after[0]), rtol=1e-9, atol=1e-9)
    assert trapezoid(np.exp(found), after[0]) == pytest.approx(1.0, abs=1e-9)


def test_without_noise_there_is_no_density() -> None:
    model, states = Ungm(q=0.0), some_states()
    assert np.allclose(
        model.propagate(states, 1.0, derive_all(9, np.arange(40)), 0.0), model.advance(states, 1.0, 0.0), rtol=1e-12
    )
    with pytest.raises(RunError, match="q > 0"):
        model.log_transition(states, states, 1.0, 0.0)


def test_the_truth_starts_at_the_start_and_is_pushed_by_the_time_of_each_step() -> None:
    states = Ungm(q=4.0).truth(3000, 1.0, np.random.default_rng(3))
    assert states.shape == (3001, 1)
    assert states[0, 0] == 0.1
    x = states[:-1, 0]
    noise = states[1:, 0] - (x / 2 + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * np.arange(3000)))
    assert kstest(noise / 2.0, "norm").pvalue > 0.01


def test_a_longer_truth_begins_like_a_shorter_one() -> None:
    short, long = (MODEL.truth(steps, 1.0, np.random.default_rng(3)) for steps in (50, 90))
    assert np.array_equal(short, long[:51])


def test_the_step_counts_through_the_time_alone() -> None:
    """Twice as many steps a second are pushed as at half the rate."""
    fine, slow = Ungm(rate=1.2).truth(50, 0.5, np.random.default_rng(3)), Ungm(rate=0.6)
    assert np.allclose(fine, slow.truth(50, 1.0, np.random.default_rng(3)), rtol=1e-9)


def test_a_filter_may_assume_more_noise() -> None:
    assert Ungm(q=2.0).assumed(10.0) == Ungm(q=20.0)


def test_readings_are_the_square_and_its_noise() -> None:
    """100 000 draws, and Kolmogorov's test. Neither the sign of the state nor the node's place counts."""
    noise, places = (
        np.random.default_rng(2).standard_normal(100_000),
        np.random.default_rng(3).normal(size=(100_000, 2)),
    )
    sensor, traits = Squared(variance=4.0), np.empty((100_000, 0))
    readings = sensor.measure(np.full((100_000, 1), -10.0), places, traits, noise)
    assert kstest(readings, norm(5.0, 2.0).cdf).pvalue > 0.01
    assert sensor.draw_traits(7, np.random.default_rng(1)).shape == (7, 0)


def test_the_likelihood_integrates_to_one_over_the_readings() -> None:
    readings = np.linspace(-40.0, 90.0, 20_001)
    owners, points = np.arange(20_001), np.full((1, 20_001), -22.0)
    places, traits = np.zeros((20_001, 2)), np.empty((20_001, 0))
    density = np.exp(Squared(variance=2.0).log_likelihood(points, readings, places, traits, owners))
    assert trapezoid(density, readings) == pytest.approx(1.0, abs=1e-9)
    assert trapezoid(density * readings, readings) == pytest.approx(22.0**2 / 20, abs=1e-9)


def test_the_likelihood_of_all_readings_is_the_product_of_each() -> None:
    points, readings = some_states(), np.array([3.0, 5.0, -1.0])
    places, traits = np.zeros((3, 2)), np.empty((3, 0))
    each = [SENSOR.log_likelihood(points, readings, places, traits, np.full(40, owner)) for owner in range(3)]
    assert np.allclose(SENSOR.log_likelihood(points, readings, places, traits), np.sum(each, axis=0), rtol=1e-12)
    assert np.allclose(each[1], norm.logpdf(5.0, points[0] ** 2 / 20, 1.0), rtol=1e-9)


@pytest.mark.parametrize("owners", [None, np.zeros(40, np.int64)])
def test_without_readings_nothing_is_learnt(owners: Any) -> None:
    nothing = SENSOR.log_likelihood(some_states(), np.empty(0), np.empty((0, 2)), np.empty((0, 0)), owners)
    assert np.array_equal(nothing, np.zeros(40))


def test_states_that_are_not_finite_are_impossible_and_warn_nobody() -> None:
    points = np.array([[1.0, np.nan, np.inf, 1e200]])
    for owners in (None, np.zeros(4, np.int64)):
        found = SENSOR.log_likelihood(points, np.array([2.0]), LARGEST_STATE, ALIKE, owners)
        assert np.isneginf(found).tolist() == [False, True, True, True]
    assert np.isfinite(SENSOR.linearise(points, LARGEST_STATE, ALIKE)[0]).tolist() == [[True, False, False, False]]
    assert np.isfinite(SENSOR.information(points, LARGEST_STATE, ALIKE)).ravel().tolist() == [True, False, False, False]


def test_linearisation_gives_the_mean_the_variance_and_the_slope_of_finite_differences() -> None:
    points, places, traits, h = some_states(), np.zeros((3, 2)), np.empty((3, 0)), 1e-5
    sensor = Squared(variance=2.5)
    expected, gradients, variances = sensor.linearise(points, places, traits)
    assert (expected.shape, gradients.shape, variances.shape) == ((3, 40), (3, 1, 40), (3, 40))
    clean = sensor.measure(points.T, np.zeros((40, 2)), np.empty((40, 0)), np.zeros(40))
    assert np.allclose(expected, clean, rtol=1e-14)
    ahead, behind = (sensor.linearise(points + shift, places, traits)[0] for shift in (h, -h))
    assert np.allclose(gradients[:, 0], (ahead - behind) / (2 * h), atol=1e-7)
    assert np.all(variances == 2.5)


@pytest.mark.parametrize("x", [-13.0, 0.5, 7.0])
def test_the_information_is_the_mean_square_of_the_score(x: float) -> None:
    """The score by finite differences of the likelihood, its mean by integration over all readings."""
    sensor, h = Squared(variance=2.0), 1e-4
    readings = x**2 / 20 + np.sqrt(2.0) * np.linspace(-9.0, 9.0, 4001)
    owners, places, traits = np.arange(4001), np.zeros((4001, 2)), np.empty((4001, 0))
    at, ahead, behind = (
        sensor.log_likelihood(np.full((1, 4001), x + shift), readings, places, traits, owners) for shift in (0.0, h, -h)
    )
    score = (ahead - behind) / (2 * h)
    found = sensor.information(np.array([[x, -x]]), np.zeros((3, 2)), np.empty((3, 0)))
    assert found.shape == (3, 1, 1, 2)
    assert np.allclose(found, trapezoid(np.exp(at) * score**2, readings), rtol=1e-6)
    assert trapezoid(np.exp(at) * score, readings) == pytest.approx(0.0, abs=1e-6)


def test_there_are_no_gains_to_assume() -> None:
    sensor = Squared(variance=2.0)
    assert sensor.assumed("unknown", True) is sensor
    assert sensor.reach == np.inf


def test_a_target_in_the_plane_is_a_fault() -> None:
    plane: Any = SimpleNamespace(motions=(ConstantVelocity(),))
    (issue,) = Squared().check(plane)
    assert issue.path == ("sensor", "kind")
    assert "2 (px py); use it with ungm or constant_acceleration" in issue.message
    for motion in (Ungm(), ConstantAcceleration()):
        line: Any = SimpleNamespace(motions=(motion,))
        assert not list(Squared().check(line))


def test_a_scenario_can_write_every_field() -> None:
    motion = create_model("Motion", **fields_of(Ungm))  # type: ignore[call-overload]
    assert Ungm(**motion(q=10, start=[0.2], rate="60 1/min").model_dump()) == Ungm(q=10.0, start=(0.2,), rate=1.0)
    sensor = create_model("Sensor", **fields_of(Squared))  # type: ignore[call-overload]
    assert Squared(**sensor(variance=2).model_dump()) == Squared(variance=2.0)
