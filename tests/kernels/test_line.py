"""The least-squares line: a twin by np.polyfit, exactness, and its error on noisy straight motion in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.kernels.line import line_at


def test_it_is_the_polynomial_of_first_degree_at_unequal_times() -> None:
    rng = np.random.Generator(np.random.Philox(4))
    for count in (2, 3, 4, 5, 9):
        times = np.cumsum(rng.uniform(0.1, 7.0, count)) + 1e4
        values = rng.uniform(-400.0, 400.0, count)
        middle = times.mean()
        expected = np.polyval(np.polyfit(times - middle, values, 1), times[-1] + 3.0 - middle)
        assert line_at(times[-1] + 3.0, times.tolist(), values.tolist()) == pytest.approx(expected, rel=1e-9)


def test_it_does_not_depend_on_the_origin_and_is_exact_on_a_line() -> None:
    times = [0.0, 2.0, 4.0, 8.0, 12.0]
    for origin in (-500.0, 0.0, 500.0):
        values = [origin - 3.0 * time for time in times]
        assert line_at(14.0, times, values) == pytest.approx(origin - 42.0, abs=1e-9)


def test_its_error_one_interval_ahead_of_five_noisy_values_has_the_variance_of_the_closed_form() -> None:
    """var = sd² (1/n + h² / Σ (k - mean)²) = 1.1 sd² for n = 5 equal intervals and h = 3."""
    noise = np.random.Generator(np.random.Philox(9)).standard_normal((20_000, 5))
    found = np.array([line_at(5.0, range(5), row) for row in noise.tolist()])
    assert found.var() == pytest.approx(1.1, rel=0.03)


def test_one_value_or_values_at_one_time_give_their_mean() -> None:
    assert line_at(9.0, [4.0], [7.0]) == 7.0
    assert line_at(9.0, [4.0, 4.0], [7.0, 9.0]) == 8.0
