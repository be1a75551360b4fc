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


def test_a_track_is_lost_where_its_error_is_above_the_limit_or_unknown_for_a_window():
    errors = np.full(60, 1.0)
    errors[10:13] = 30.0
    errors[20:24] = 10.1
    errors[30:32], errors[32:36] = NAN, 1e20
    errors[40:60:2] = 50.0
    lost = metrics.lost_steps(errors, window=4, limit=10.0)
    assert np.flatnonzero(lost).tolist() == [*range(20, 24), *range(30, 36)], "at the limit, or for 3 steps: it is not"
    assert metrics.count_losses(lost) == 2
    assert metrics.lost_steps(np.full(40, NAN), 4, math.inf).all()
    assert not metrics.lost_steps(np.full(40, 1e9), 4, math.inf).any()
    assert (
        not metrics.lost_steps(np.full(40, NAN), 41, 10.0).any() and metrics.lost_steps(np.empty(0), 4, 1.0).size == 0
    )


@pytest.mark.thorough
def test_the_bootstrap_interval_covers_the_mean_of_a_known_population():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(60):
        errors = np.abs(rng.normal(0, 3, (40, 5)))
        low, high = metrics.bootstrap_interval(errors, metrics.time_mean_rmse, draws=200)
        hits += low <= 3.0 <= high
    assert hits >= 48
    assert math.isnan(metrics.bootstrap_interval(np.ones((4, 3)), metrics.time_mean_rmse)[0])


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


def test_losses_are_those_of_a_search_of_every_window():
    """A step is lost that is in any window of bad steps alone."""
    rng = np.random.default_rng(5)
    for _ in range(100):
        count, window = int(rng.integers(1, 80)), int(rng.integers(1, 12))
        errors = np.exp(np.cumsum(rng.normal(0.0, 0.6, count))) * 10.0
        errors[rng.random(count) < rng.choice([0.0, 0.3, 0.6])] = NAN
        starts = [k for k in range(count - window + 1) if all(not e <= 20.0 for e in errors[k : k + window])]
        by_hand = [any(k <= step < k + window for k in starts) for step in range(count)]
        assert metrics.lost_steps(errors, window, 20.0).tolist() == by_hand
