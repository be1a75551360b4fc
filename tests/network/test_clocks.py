"""Clocks that drift and jump, against sums by hand."""

import numpy as np
import pytest

from wsnsim.models.hardware import DriftingClock, PerfectClock
from wsnsim.network.clocks import Clocks

HOUR = 3600.0


def test_a_true_clock_is_never_wrong_and_a_timer_lasts_what_it_says():
    clocks = Clocks(PerfectClock(), 3, 5)
    assert not clocks.drift and clocks.rate(2) == 1.0 and clocks.lasts(2, 0.3) == 0.3
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
    assert clocks.drift and [few.rate(i) for i in range(10)] == [clocks.rate(i) for i in range(10)]
    errors = clocks.error(np.arange(20_000), 1.0)
    # A normal cut at three deviations has the deviation 0.9866; 20,000 draws know theirs to 0.5 %.
    assert errors.std() == pytest.approx(0.9866 * 30e-6, rel=0.02)
    assert abs(errors.mean()) < 4 * 30e-6 / 20_000**0.5
    assert np.abs(errors).max() <= 90e-6 and np.abs(errors).max() == pytest.approx(clocks.largest_error(1.0), rel=1e-9)
    assert Clocks(DriftingClock(), 8, 10).rate(0) != few.rate(0)
