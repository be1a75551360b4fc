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


def _lost_by_hand(errors, window, limit):
    """The steps at which a track is lost, from the sentences of `metrics.lost_steps`, step by step."""
    window = min(window, len(errors))
    state, states = False, []
    for k in range(window, len(errors) + 1):
        known = [e for e in errors[k - window : k] if math.isfinite(e)]
        mean = sum(known) / len(known) if known else math.inf
        few = 2 * len(known) <= window
        if few or mean > limit:
            state = True
        elif mean <= limit / 2:
            state = False
        states.append(state)
    return [states[0]] * (window - 1) + states


def test_losses_are_excursions_of_the_windowed_mean_error_with_hysteresis():
    errors = np.full(60, 1.0)
    errors[10:20] = 30.0
    errors[30:40] = NAN
    lost = metrics.lost_steps(errors, window=4, limit=10.0)
    assert lost.tolist() == _lost_by_hand(errors, 4, 10.0)
    assert metrics.count_losses(lost) == 2
    # mean of 4 steps above 10 m with the second step at 30 m; back at 1 m when the last of them has left the window
    assert np.flatnonzero(lost).tolist() == [*range(11, 23), *range(31, 42)]
    errors[20:30] = 7.0  # below the limit, yet above half of it: the first loss lasts until the error is small
    assert metrics.count_losses(metrics.lost_steps(errors, window=4, limit=10.0)) == 1


def test_an_error_that_wavers_about_the_limit_is_one_loss():
    errors = np.where(np.arange(100) % 2, 9.0, 11.0)
    assert metrics.count_losses(metrics.lost_steps(errors, window=1, limit=10.0)) == 1
    errors[50:] = 4.0
    assert metrics.lost_steps(errors, window=1, limit=10.0).sum() == 50


def test_the_first_window_decides_on_all_of_its_steps():
    assert metrics.lost_steps(np.full(40, NAN), window=100).all()
    errors = np.full(300, 50.0)
    errors[100:] = 0.0
    lost = metrics.lost_steps(errors)
    assert lost[: 100 + 79].all() and not lost[179:].any()  # the mean of the window that ends at index 179 is 10 m
    assert not metrics.lost_steps(np.full(300, 1e9), limit=math.inf).any()
    assert metrics.lost_steps(np.full(300, NAN), limit=math.inf).all()
    assert metrics.lost_steps(np.empty(0)).size == 0


def test_losses_agree_with_the_first_loss_and_with_the_loss_at_the_end():
    rng = np.random.default_rng(5)
    seen = set()
    for _ in range(400):
        count, window = int(rng.integers(1, 80)), int(rng.integers(1, 40))
        errors = np.exp(np.cumsum(rng.normal(0.0, 0.6, count))) * 10.0
        errors[rng.random(count) < rng.choice([0.0, 0.3, 0.6])] = NAN
        lost = metrics.lost_steps(errors, window, 20.0)
        assert lost.tolist() == _lost_by_hand(errors, window, 20.0)
        assert (metrics.count_losses(lost) > 0) == lost.any() == math.isfinite(metrics.first_lost(errors, window, 20.0))
        assert lost[-1] or not metrics.is_lost(errors, window, 20.0)
        seen.add((bool(lost.any()), metrics.is_lost(errors, window, 20.0)))
    assert seen == {(False, False), (True, False), (True, True)}


def test_an_error_beyond_all_measure_does_not_blur_the_windows_after_it():
    errors = np.full(400, 30.0)
    errors[100:110] = 1e20
    errors[200:] = 2.0
    assert metrics.lost_steps(errors).tolist() == _lost_by_hand(errors, 100, 20.0)
