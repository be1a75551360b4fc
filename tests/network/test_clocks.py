"""Clocks that drift and jump, against sums by hand."""

import numpy as np
import pytest
import simpy

from wsnsim.models.hardware import DriftingClock, PerfectClock
from wsnsim.network.clocks import Clocks

HOUR = 3600.0


def test_a_true_clock_is_never_wrong_and_a_timer_lasts_what_it_says():
    clocks = Clocks(PerfectClock(), 3, 5)
    assert clocks.perfect and clocks.rate(2) == 1.0 and clocks.lasts(2, 0.3) == 0.3
    assert clocks.error(np.arange(5), HOUR).tolist() == [0.0] * 5 and clocks.largest_error(HOUR) == 0.0


def test_a_clock_that_is_30_ppm_fast_is_108_ms_ahead_after_an_hour():
    class Fast:
        def rates(self, keys):
            return np.full(len(keys), 1.0 + 30e-6)

    clocks = Clocks(Fast(), 3, 2)
    assert clocks.error(np.array([1]), HOUR)[0] == pytest.approx(0.108, rel=1e-9)
    assert clocks.lasts(1, 1.0 + 30e-6) == pytest.approx(1.0, rel=1e-15)
    assert clocks.largest_error(HOUR) == pytest.approx(0.108, rel=1e-9)


def test_steps_add_up_on_their_nodes_alone_and_bound_the_error():
    clocks = Clocks(PerfectClock(), 3, 4)
    clocks.step([1, 2], 0.5)
    clocks.step([2], -2.0)
    assert clocks.error(np.array([0, 1, 2, 3]), 10.0).tolist() == [0.0, 0.5, -1.5, 0.0]
    assert clocks.largest_error(10.0) == 1.5
    clocks.step([2], 2.0)
    clocks.step([1, 2], -0.5)
    assert clocks.largest_error(10.0) == 0.0 and not clocks.error(np.arange(4), 10.0).any()


def test_a_nodes_rate_is_its_own_spread_as_stated_and_no_error_exceeds_the_bound():
    clocks, few = Clocks(DriftingClock(), 7, 20_000), Clocks(DriftingClock(), 7, 10)
    assert not clocks.perfect and [few.rate(i) for i in range(10)] == [clocks.rate(i) for i in range(10)]
    errors = clocks.error(np.arange(20_000), 1.0)
    # A normal cut at three deviations has the deviation 0.9866; 20,000 draws know theirs to 0.5 %.
    assert errors.std() == pytest.approx(0.9866 * 30e-6, rel=0.02)
    assert abs(errors.mean()) < 4 * 30e-6 / 20_000**0.5
    assert np.abs(errors).max() <= 90e-6 and np.abs(errors).max() == pytest.approx(clocks.largest_error(1.0), rel=1e-9)
    assert Clocks(DriftingClock(), 8, 10).rate(0) != few.rate(0)


class Wrong:
    """Clocks of given rates and offsets."""

    def __init__(self, rates, offsets):
        self._rates, self._offsets = np.array(rates), np.array(offsets)

    def rates(self, keys):
        return self._rates

    def offsets(self, keys):
        return self._offsets


def at(time, *arguments):
    """Clocks and the environment that gives their time, which is `time` now."""
    env = simpy.Environment(initial_time=time)
    return Clocks(*arguments, env), env


def test_what_clocks_show_and_when_they_show_it_are_inverse_with_drift_offsets_steps_and_corrections():
    rng = np.random.default_rng(3)
    clocks, env = at(0.0, Wrong(1.0 + rng.normal(0, 1e-3, 6), rng.normal(0, 5.0, 6)), 1, 6)
    nodes = np.arange(6)
    for time in (0.0, 10.0, 200.0):
        env.run(until=time) if time else None
        clocks.step([1, 4], 0.5)
        clocks.correct(2, -0.25)
        clocks.correct(3, 7.0, 1.0 + 1e-4)
        for later in (time, time + 3.0, time + 1e4):
            shown = clocks.local_times(nodes, later)
            assert np.allclose(shown, later + clocks.error(nodes, later), rtol=0, atol=1e-12)
            assert [clocks.true_time(node, float(shown[node])) for node in nodes] == pytest.approx(
                [later] * 6, abs=1e-9
            )


def test_a_correction_puts_the_clock_forward_and_makes_it_run_at_the_estimated_rate_and_steps_it_not_the_timers():
    clocks, env = at(0.0, Wrong([1.0 + 4e-5, 1.0], [0.002, 0.0]), 1, 2)
    env.run(until=100.0)
    assert clocks.error(np.array([0]), 100.0)[0] == pytest.approx(0.006, abs=1e-11)
    clocks.correct(0, -0.006, 1.0 + 4e-5)
    assert np.abs(clocks.error(np.array([0]), 1e5)).max() < 1e-11
    assert clocks.raw_time(0) == pytest.approx(100.006, abs=1e-10) and clocks.raw_time(1) == 100.0
    assert clocks.lasts(0, 1.0) == 1.0 / (1.0 + 4e-5)
    clocks.correct(0, 0.5)
    assert clocks.error(np.array([0]), 2000.0)[0] == pytest.approx(0.5, abs=1e-11)
    clocks.step([0], 1.0)
    assert clocks.raw_time(0) == pytest.approx(101.006, abs=1e-10)
    assert clocks.corrected(0) == pytest.approx(0.494, abs=1e-12)
    clocks.forget(0)
    assert clocks.error(np.array([0]), 200.0)[0] == pytest.approx(1.002 + 200 * 4e-5, abs=1e-10)
    assert clocks.corrected(0) == 0.0


def test_the_largest_error_bounds_every_clock_whatever_happened_to_it():
    rng = np.random.default_rng(5)
    clocks, env = at(0.0, Wrong(1.0 + rng.normal(0, 1e-3, 9), rng.normal(0, 1.0, 9)), 1, 9)
    changes = [lambda i: clocks.step([i], 0.3), lambda i: clocks.correct(i, -0.7, 1.0 + 1e-3), clocks.forget]
    for number in range(30):
        env.run(until=env.now + 1.0)
        errors = np.abs(clocks.error(np.arange(9), env.now))
        assert errors.max() <= clocks.largest_error(env.now) * (1 + 1e-12)
        changes[number % 3](number % 9)


def test_perfect_clocks_are_not_corrected_until_one_of_them_is_stepped():
    clocks, _ = at(5.0, PerfectClock(), 1, 3)
    changed = []
    clocks.on_step.append(changed.append)
    clocks.correct(1, 0.5, 1.1)
    clocks.forget(1)
    assert clocks.perfect and not changed and clocks.local_times(np.arange(3), 7.0).tolist() == [7.0] * 3
    clocks.step([0, 1], 0.25)
    assert not clocks.perfect and changed == [0, 1] and clocks.true_time(1, 7.25) == 7.0
    clocks.correct(1, -0.25)
    assert changed == [0, 1, 1] and clocks.error(np.arange(3), 9.0).tolist() == [0.25, 0.0, 0.0]


def test_offsets_at_the_start_are_spread_as_stated_and_independent_of_the_rates():
    clocks = Clocks(DriftingClock(sd=1e-4, offset=5e-3), 7, 20_000)
    offsets = clocks.error(np.arange(20_000), 0.0)
    assert offsets.std() == pytest.approx(0.9866 * 5e-3, rel=0.02) and np.abs(offsets).max() <= 15e-3
    rates = np.array([clocks.rate(i) for i in range(20_000)])
    assert abs(np.corrcoef(offsets, rates)[0, 1]) < 4 / 20_000**0.5
    assert [clocks.rate(i) for i in range(5)] == [Clocks(DriftingClock(sd=1e-4), 7, 5).rate(i) for i in range(5)]
