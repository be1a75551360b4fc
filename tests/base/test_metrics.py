import math

import numpy as np
import pytest

from wsnsim.base import metrics

NAN = float("nan")


def test_the_published_figure_is_the_time_mean_of_the_root_mean_square_over_runs():
    errors = np.array([[3.0, 0.0], [4.0, 2.0]])
    assert metrics.per_step_rmse(errors) == pytest.approx([math.sqrt(12.5), math.sqrt(2.0)])
    assert metrics.time_mean_rmse(errors) == pytest.approx((math.sqrt(12.5) + math.sqrt(2.0)) / 2)


def test_steps_without_an_estimate_are_left_out():
    errors = np.array([[3.0, NAN, 4.0]])
    assert metrics.rmse(errors) == pytest.approx(math.sqrt(12.5))
    assert metrics.median_error(errors) == 3.5
    assert metrics.per_step_rmse(np.array([[NAN, 1.0], [NAN, 1.0]])).tolist()[1] == 1.0
    assert math.isnan(metrics.rmse(np.array([NAN])))


def test_a_track_is_lost_by_its_last_hundred_steps_alone():
    good, bad = np.full(600, 2.0), np.full(600, 2.0)
    bad[-100:] = 20.1
    assert not metrics.is_lost(good)
    assert metrics.is_lost(bad)
    recovered = np.full(600, 50.0)
    recovered[-100:] = 19.9
    assert not metrics.is_lost(recovered)


def test_a_track_without_estimates_is_lost():
    assert metrics.is_lost(np.full(300, NAN))
    half = np.full(100, 1.0)
    half[:50] = NAN
    assert metrics.is_lost(half)
    half[49] = 1.0
    assert not metrics.is_lost(half)


def test_the_bootstrap_interval_covers_the_mean_of_a_known_population():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(60):
        errors = np.abs(rng.normal(0, 3, (40, 5)))
        low, high = metrics.bootstrap_interval(errors, metrics.time_mean_rmse, draws=200)
        hits += low <= 3.0 <= high
    assert hits >= 48
    assert math.isnan(metrics.bootstrap_interval(np.ones((4, 3)), metrics.time_mean_rmse)[0])


def test_a_track_is_first_lost_at_the_end_of_its_first_bad_window():
    errors = np.full(600, 2.0)
    errors[200:400] = 50.0
    by_hand = next(k for k in range(100, 601) if metrics.is_lost(errors[:k]))
    assert metrics.first_lost(errors) == by_hand
    assert math.isnan(metrics.first_lost(np.full(600, 2.0)))
    assert metrics.first_lost(np.full(40, NAN)) == 40
    errors[:] = 2.0
    errors[300:360] = NAN
    assert metrics.first_lost(errors) == next(k for k in range(100, 601) if metrics.is_lost(errors[:k]))


def test_a_step_is_tracked_if_its_estimate_came_before_the_next_step_from_enough_readings():
    """Of five steps of 2 s: in time, at the last instant, too late, never; and in time, from one reading alone."""
    times = np.array([2.0, 4.0, 6.0, 8.0, 10.0])
    issued = np.array([2.5, 6.0, 8.1, NAN, 10.0])
    readings = np.array([3, 4, 5, 0, 1])
    assert metrics.tracked_share(issued, times, readings, 2.0, 1) == pytest.approx(3 / 5)
    assert metrics.tracked_share(issued, times, readings, 2.0, 3) == pytest.approx(2 / 5)
    assert metrics.tracked_share(issued, times, np.zeros(5, dtype=int), 2.0, 1) == 0.0


def test_the_mean_error_is_over_the_steps_that_have_an_estimate():
    assert metrics.mean_error(np.array([1.0, NAN, 5.0])) == 3.0
    assert math.isnan(metrics.mean_error(np.array([NAN])))
