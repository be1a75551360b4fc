"""The grey model and the line through a short series."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from wsnsim.kernels.grey import check, equal_intervals, forecast, forecast_at, gm11, line_at, residuals_of

SLOW = [2.874, 3.278, 3.337, 3.390, 3.679]
FAST = [120, 151, 183, 214, 247]
CORRECTIONS = ("none", "tail", "literal")


def predict(x, ahead=1.0, shift=0.0):
    """The model without a correction."""
    return forecast(x, ahead, shift, "none")


def checked(x):
    """(C, p) of the model of a series."""
    return check(x, residuals_of(x, *gm11(x)))


def passes(x):
    """Whether the model of a series needs no correction."""
    ratio, share = checked(x)
    return ratio <= 0.35 and share >= 0.95


def fit_twin(x):
    """Least squares by the design matrix, not by the closed form."""
    total = np.cumsum(x)
    z = (total[:-1] + total[1:]) / 2.0
    (a, u), *_ = np.linalg.lstsq(np.stack([-z, np.ones(z.size)], axis=1), x[1:], rcond=None)
    return a, u


def restored_twin(first, a, u, index):
    """The difference of the summed series' exponential at two neighbouring indices."""
    summed = [(first - u / a) * np.exp(-a * i) + u / a for i in (index - 1.0, index)]
    return summed[1] - summed[0]


def forecast_twin(x, ahead, shift, correction):
    x = np.asarray(x, dtype=float) + shift
    a, u = fit_twin(x)
    n = x.size
    result = restored_twin(x[0], a, u, n - 1 + ahead)
    q = x - np.array([x[0], *(restored_twin(x[0], a, u, i) for i in range(1, n))])
    accepted = q.std() / x.std() <= 0.35 and np.mean(np.abs(q - q.mean()) < 0.6745 * x.std()) >= 0.95
    if correction == "tail" and not accepted:
        tail = q[1:]
        c = max(0.0, -tail.min()) + np.ptp(tail) + 1e-6
        result += restored_twin(tail[0] + c, *fit_twin(tail + c), n - 2 + ahead) - c
    elif correction == "literal" and not accepted:
        result += restored_twin(0.0, *fit_twin(q), n - 1 + ahead)
    return result - shift, accepted


def test_the_first_vector_of_the_page() -> None:
    a, u = gm11(SLOW)
    assert (a, u) == pytest.approx((-0.0372043819436, 3.0653633130015), abs=1e-13)
    assert predict(SLOW) == pytest.approx(3.750656, abs=5e-7)
    assert checked(SLOW) == (pytest.approx(0.2124719861, abs=1e-10), 1.0)


def test_the_second_vector_in_exact_fractions() -> None:
    a, u = gm11(FAST)
    assert a == pytest.approx(float(Fraction(-101442, 634615)), rel=1e-13)
    assert u == pytest.approx(float(Fraction(77678496, 634615)), rel=1e-13)
    assert predict(FAST) == pytest.approx(290.986340, abs=5e-7)
    assert predict(FAST, shift=500.0) == pytest.approx(282.051481, abs=5e-7)
    assert checked(FAST) == (pytest.approx(0.04651901, abs=5e-9), 1.0)


def test_unequal_times_are_those_of_the_page_and_the_index_is_fractional() -> None:
    times, values = [3.4, 10, 20, 30, 40], [50, 70, 95, 128, 150]
    x, spacing = equal_intervals(times, values), 9.15
    assert x == pytest.approx([50, 76.375, 100.61, 129.87, 150])
    ahead = (50.0 - 40.0) / spacing
    assert 4 + ahead == pytest.approx(5.0928961749, abs=1e-10)
    assert predict(x, ahead) == pytest.approx(193.277324, abs=5e-7)
    assert predict(x, ahead, 500.0) == pytest.approx(181.694558, abs=5e-7)


@pytest.mark.parametrize("count", [2, 3, 5, 64])
def test_equal_intervals_are_numpys_interpolation_and_a_forecast_for_a_time_uses_them(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(50):
        times, x = np.cumsum(rng.exponential(3.0, count)) + 1e-3, rng.normal(0.0, 90.0, count)
        k, found = np.linspace(times[0], times[-1], count), equal_intervals(times, x)
        assert found == pytest.approx(np.interp(k, times, x), abs=1e-9)
        ahead = 2.5 / (k[1] - k[0])
        asked = forecast_at(times[-1] + 2.5, times.tolist(), x.tolist(), 500.0, "tail")
        assert asked == pytest.approx(forecast(found, ahead, 500.0, "tail"), rel=1e-6, abs=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("correction", CORRECTIONS)
@pytest.mark.parametrize("count", [4, 5, 9, 64])
def test_noisy_tracks_are_those_of_the_twin(count: int, correction: str) -> None:
    rng, failed = np.random.default_rng(count), 0
    for _ in range(100):
        x = rng.uniform(-250.0, 250.0) + rng.uniform(-6.0, 6.0) * np.arange(count) + rng.normal(0.0, 6.0, count)
        ahead = rng.uniform(0.1, 3.0)
        expected, accepted = forecast_twin(x, ahead, 500.0, correction)
        assert gm11(x + 500.0) == pytest.approx(fit_twin(x + 500.0), rel=1e-6, abs=1e-9)
        assert forecast(x, ahead, 500.0, correction) == pytest.approx(expected, rel=1e-6, abs=1e-5)
        failed += not accepted
    assert failed > 10, "the check fails often enough to be seen"


def test_an_exponential_is_its_own_model_and_is_continued() -> None:
    """x_i = c r^(i-1) has a = 2 (1 - r)/(1 + r); the restored model differs from it by what the mean z leaves."""
    r, c = 1.05, 40.0
    x = c * r ** np.arange(6)
    a, u = gm11(x)
    assert a == pytest.approx(2.0 * (1.0 - r) / (1.0 + r), rel=1e-9)
    assert u == pytest.approx(c * 2.0 / (1.0 + r), rel=1e-9), "u = x_2 + a z_2"
    assert predict(x, 2.0) == pytest.approx(c * r**7, rel=2e-3)


@pytest.mark.parametrize("correction", CORRECTIONS)
@pytest.mark.parametrize("shift", [0.0, 500.0])
@pytest.mark.parametrize("value", [0.0, 7.0, -3.5, 0.1, 1e6])
def test_a_constant_stays_where_it_is_though_it_may_fail_the_check(value: float, shift: float, correction: str) -> None:
    for count in (2, 3, 4, 5):
        assert forecast([value] * count, 1.7, shift, correction) == pytest.approx(value, abs=1e-5 + 1e-9 * abs(value))
    assert not passes([7.0] * 5), "p = 0: none of the residuals is below 0.6745 times 0"


def test_without_a_fit_the_last_value_stays() -> None:
    assert gm11([3.0, 8.0]) == (0.0, 8.0) and predict([3.0, 8.0], 5.0) == 8.0
    alternating = [1.0, -1.0, 1.0, -1.0, 1.0]  # every z is a half: D = 0
    assert gm11(alternating) == (0.0, 1.0) and predict(alternating) == 1.0
    assert predict(alternating[:4]) == -1.0


@pytest.mark.parametrize("correction", CORRECTIONS)
@pytest.mark.parametrize("shift", [0.0, 500.0])
@pytest.mark.parametrize(
    "x",
    [
        [5.0, -5.0, 5.0, -5.0, 5.0],
        [-20.0, -7.0, 3.0, 15.0, 26.0],
        [40.0, 30.0, 20.0, 10.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0],
        [1e-300, -1e-300, 1e-300, 2e-300, 0.0],
        [1e308, -1e308, 1e308, 1e308, -1e308],
        [-500.0, -500.0, -499.0, -500.0],
        [1.0, -2.0, 1.0],
    ],
)
def test_what_it_says_is_always_a_number(x: list[float], shift: float, correction: str) -> None:
    for ahead in (0.0, 0.3, 1.0, 50.0, 1e6):
        assert math.isfinite(forecast(x, ahead, shift, correction))
    assert all(map(math.isfinite, gm11(x)))


def test_a_series_that_falls_to_zero_goes_on_near_it_with_the_shift() -> None:
    assert predict([40.0, 30.0, 20.0, 10.0, 0.0], shift=500.0) == pytest.approx(-10.0, abs=0.6)


def test_literal_corrections_do_next_to_nothing_and_those_of_the_tail_something() -> None:
    rng, added = np.random.default_rng(3), {"literal": [], "tail": []}
    for _ in range(300):
        x = rng.uniform(-200.0, 200.0) + rng.normal(0.0, 3.0, 5)
        if not passes(x + 500.0):
            for word, found in added.items():
                found.append(abs(forecast(x, 1.0, 500.0, word) - predict(x, 1.0, 500.0)))
    assert max(added["literal"]) < 0.1 < np.median(added["tail"])


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
