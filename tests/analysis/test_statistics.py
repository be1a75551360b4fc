"""What replicates say, against formulas written by hand, brute force, and what is known of the bootstrap exactly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from wsnsim.analysis import statistics

NAN = float("nan")
SMALL = st.lists(st.integers(-6, 6), min_size=1, max_size=12)
FIGURES = st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0, NAN, math.inf]), max_size=9)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.integers(0, 3))
def test_medians_and_means_are_of_the_values_that_are_known(values: list[float], unknown: int) -> None:
    given_ = np.array([*values, *[NAN] * unknown])
    ordered, half = sorted(values), len(values) // 2
    middle = ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2
    found, average = statistics.median(given_), statistics.mean(given_)
    assert found.value == pytest.approx(middle)
    assert average.value == pytest.approx(math.fsum(values) / len(values), abs=1e-6)
    assert found.known == average.known == len(values)
    for estimate in (found, average):
        if len(values) < 5:
            assert math.isnan(estimate.low)
            assert math.isnan(estimate.high)
        else:
            rounding = 1e-9 * max(map(abs, values))
            assert min(values) - rounding <= estimate.low <= estimate.high <= max(values) + rounding


def test_unknown_values_change_nothing() -> None:
    values = np.random.default_rng(0).normal(size=12)
    mixed = np.insert(values, [0, 4, 12], [NAN, math.inf, -math.inf])
    assert statistics.median(mixed) == statistics.median(values)
    assert statistics.mean(mixed) == statistics.mean(values)


@pytest.mark.parametrize("values", [[], [NAN, NAN], [math.inf]])
def test_where_nothing_is_known_nothing_is_said(values: list[float]) -> None:
    for found in (statistics.median(np.array(values)), statistics.mean(np.array(values))):
        assert found.known == 0
        assert all(math.isnan(value) for value in found[:3])


def test_equal_values_have_an_interval_of_no_width() -> None:
    assert statistics.median(np.full(9, 3.5)) == (3.5, 3.5, 3.5, 9)
    assert statistics.mean(np.full(5, 0.1)) == pytest.approx((0.1, 0.1, 0.1, 5))


def test_equal_values_give_equal_intervals_whatever_was_drawn_before() -> None:
    values = np.random.default_rng(1).normal(size=30)
    first = statistics.median(values), statistics.mean(values)
    np.random.default_rng().normal(size=10)
    statistics.mean(values[:7])
    assert (statistics.median(values), statistics.mean(values)) == first


def test_intervals_follow_a_change_of_unit() -> None:
    values = np.random.default_rng(2).lognormal(size=25)
    for figure in (statistics.median, statistics.mean):
        metres, other = figure(values), figure(1000.0 * values + 5.0)
        assert other[:3] == pytest.approx([1000.0 * value + 5.0 for value in metres[:3]])


@pytest.mark.parametrize("count", [5, 9, 15, 31, 101])
def test_the_medians_interval_ends_where_the_bootstraps_exact_distribution_says(count: int) -> None:
    """Of an odd number of values, the resampled median is at most the k-th with P(binomial(n, k / n) > n / 2)."""
    values = np.sort(np.random.default_rng(count).lognormal(size=count))
    chance = stats.binom.sf(count // 2, count, np.arange(count + 1) / count)
    found = statistics.median(values)
    four_deviations = 4 * math.sqrt(0.025 * 0.975 / statistics.DRAWS)
    for end, level in ((found.low, 0.025), (found.high, 0.975)):
        below, up_to = np.searchsorted(values, [end * (1 - 1e-12), end * (1 + 1e-12)])  # the ends are interpolated
        assert chance[below] <= level + four_deviations
        assert chance[up_to] >= level - four_deviations


@pytest.mark.thorough
def test_the_medians_interval_covers_the_true_median_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(7)
    runs = 100
    found = [statistics.median(rng.lognormal(size=20))[1:3] for _ in range(runs)]
    covered = sum(low <= 1.0 <= high for low, high in found) / runs
    assert 0.87 <= covered <= 0.995, "four standard deviations below 0.95"


def test_the_means_interval_is_that_of_the_normal_law_for_many_values() -> None:
    values = np.random.default_rng(3).normal(10.0, 2.0, 400)
    found = statistics.mean(values)
    half = 1.96 * values.std() / 20.0
    assert (found.low, found.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.15 * half)


@pytest.mark.thorough(fast=["median-33"])
@pytest.mark.parametrize("count", [5, 33, 1500])
@pytest.mark.parametrize("statistic", [np.median, np.mean])
def test_the_bootstrap_is_that_of_scipy(count: int, statistic: Callable[..., Any]) -> None:
    values = np.random.default_rng(count).lognormal(size=count)
    expected = stats.bootstrap(
        (values,), statistic, n_resamples=statistics.DRAWS, method="percentile", vectorized=True,
        batch=max(1, statistics.MOST_SAMPLED // count), rng=np.random.Generator(np.random.Philox(count)),
    ).confidence_interval  # fmt: skip
    assert statistics._bootstrapped(values, statistic) == pytest.approx(expected, rel=1e-13)


@given(st.integers(1, 400), st.data())
def test_the_interval_of_a_share_is_wilsons(count: int, data: st.DataObject) -> None:
    happened = data.draw(st.integers(0, count))
    found = statistics.share(np.arange(count) < happened)
    z, p = stats.norm.ppf(0.975), happened / count
    centre = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    assert found.value == p
    assert (found.low, found.high) == pytest.approx((max(0.0, centre - half), min(1.0, centre + half)), abs=1e-12)
    assert found.known == count


def test_a_share_of_no_runs_is_not_known() -> None:
    found = statistics.share(np.array([], dtype=bool))
    assert found.known == 0
    assert math.isnan(found.value)


@given(SMALL)
def test_the_effect_is_the_share_of_pairs_for_less_those_against(differences: list[int]) -> None:
    """The signs of all Walsh sums, each difference with itself among them: Tukey's form of the signed ranks."""
    found = statistics.paired_difference(np.array(differences, dtype=float), np.zeros(len(differences)))
    moved = [value for value in differences if value]
    sums = [np.sign(a + b) for a, b in itertools.combinations_with_replacement(moved, 2)]
    assert found.effect == pytest.approx(sum(sums) / len(sums) if sums else 0.0)
    assert found.value == float(np.median(differences))
    assert found.known == len(differences)


@pytest.mark.parametrize("equal", [False, True])
@pytest.mark.parametrize("count", [1, 2, 5, 8, 10])
def test_p_is_the_share_of_all_choices_of_signs_that_are_as_extreme(count: int, equal: bool) -> None:
    differences = np.random.default_rng(count).normal(0.5, 1.0, count)
    if equal:
        differences = np.sign(differences) * np.ceil(2 * np.abs(differences))
    ranks = stats.rankdata(np.abs(differences))
    seen = abs(float(ranks @ np.sign(differences)))
    signs = np.array(list(itertools.product([-1.0, 1.0], repeat=count)))
    expected = np.mean(np.abs(signs @ ranks) >= seen - 1e-9)
    assert statistics.paired_difference(differences, np.zeros(count)).p == pytest.approx(expected)


@pytest.mark.parametrize("count", [14, 50, 51, 80])
def test_p_is_that_of_the_reference_where_no_two_differences_are_equal(count: int) -> None:
    differences = np.random.default_rng(count).normal(0.3, 1.0, count)
    expected = stats.wilcoxon(differences, method="exact" if count <= 50 else "asymptotic").pvalue
    assert statistics.paired_difference(differences, np.zeros(count)).p == pytest.approx(expected)


@given(st.lists(st.tuples(st.integers(-5, 5), st.integers(-5, 5)), min_size=5, max_size=15))
def test_the_other_way_round_a_difference_has_the_other_sign(pairs: list[tuple[int, int]]) -> None:
    one, other = np.array(pairs, dtype=float).T
    there, back = statistics.paired_difference(one, other), statistics.paired_difference(other, one)
    assert (back.value, back.effect) == (-there.value, pytest.approx(-there.effect))
    assert (back.p, back.known) == (pytest.approx(there.p), there.known)


def test_a_shift_of_every_pair_is_found_and_noise_that_both_share_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    shared = rng.lognormal(3.0, 2.0, 40)
    found = statistics.paired_difference(shared + 0.1 + rng.normal(0.0, 0.01, 40), shared)
    assert found.value == pytest.approx(0.1, abs=0.01)
    assert 0.09 < found.low <= found.value <= found.high < 0.11
    assert (found.effect, found.known) == (1.0, 40)
    assert found.p < 1e-6


def test_pairs_of_which_a_half_is_unknown_do_not_count() -> None:
    one, other = np.array([1.0, 2.0, NAN, 4.0, math.inf, 6.0]), np.array([0.0, NAN, 3.0, 5.0, math.inf, 4.0])
    found = statistics.paired_difference(one, other)
    assert (found.value, found.known) == (1.0, 3)
    assert math.isnan(found.low)
    nothing = statistics.paired_difference(one[1:3], other[1:3])
    assert nothing.known == 0
    assert all(math.isnan(value) for value in nothing[:5])


def test_equal_runs_have_no_difference_and_no_effect() -> None:
    values = np.arange(6.0)
    assert statistics.paired_difference(values, values) == (0.0, 0.0, 0.0, 0.0, 1.0, 6)


@given(FIGURES, st.randoms(use_true_random=False))
def test_the_front_is_all_that_nobody_beats(errors: list[float], random) -> None:
    costs = [random.choice([0.0, 1.0, 2.0, NAN]) for _ in errors]
    points = list(zip(errors, costs, strict=True))

    def beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
        return all(map(math.isfinite, one)) and one != other and one[0] <= other[0] and one[1] <= other[1]

    expected = [all(map(math.isfinite, p)) and not any(beats(q, p) for q in points) for p in points]
    assert statistics.pareto_front(errors, costs).tolist() == expected


def test_mcnemar_gives_the_textbook_numbers() -> None:
    """By hand, 9 against 1: 2 (1 + 10) / 1024. Agresti, Categorical Data Analysis, table 10.1: 86 against 150."""
    assert statistics.exact_mcnemar(1, 9) == statistics.exact_mcnemar(9, 1) == pytest.approx(22 / 1024)
    assert statistics.exact_mcnemar(86, 150) == pytest.approx(3.716e-5, rel=1e-3)
    assert statistics.exact_mcnemar(0, 0) == statistics.exact_mcnemar(4, 4) == 1.0
    assert statistics.exact_mcnemar(0, 6) == pytest.approx(2 / 64)


@given(st.integers(0, 40), st.integers(0, 40))
def test_mcnemar_is_the_two_sided_binomial_test_of_the_discordant_pairs(one: int, other: int) -> None:
    expected = stats.binomtest(one, one + other, 0.5).pvalue if one + other else 1.0
    assert statistics.exact_mcnemar(one, other) == pytest.approx(expected, rel=1e-9)


@pytest.mark.thorough
def test_mcnemar_rejects_at_most_five_percent_of_equal_strategies() -> None:
    """Exactly, over all outcomes of 30 runs that lose independently with probability 0.2 each."""
    count, lose = 30, 0.2
    differ = 2 * lose * (1 - lose)
    rejected = 0.0
    for n in range(count + 1):
        of_n = sum(stats.binom.pmf(k, n, 0.5) for k in range(n + 1) if statistics.exact_mcnemar(k, n - k) <= 0.05)
        rejected += stats.binom.pmf(n, count, differ) * of_n
    assert 0.0 < rejected <= 0.05


def test_holm_gives_the_textbook_numbers() -> None:
    """Holm (1979): the smallest of m times m, the next times m - 1, never falling, at most 1."""
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.01, 0.02, 0.03, 0.04, 0.05]) == pytest.approx([0.05, 0.08, 0.09, 0.09, 0.09])
    assert statistics.holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert statistics.holm([0.04]) == [0.04]
    unknown = statistics.holm([NAN, 0.02, 0.04])
    assert math.isnan(unknown[0]) and unknown[1:] == pytest.approx([0.04, 0.04]), "what was not tested does not count"
    assert statistics.holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), max_size=12))
def test_holm_is_never_below_the_raw_p_and_keeps_its_order(p: list[float]) -> None:
    found = statistics.holm(p)
    assert all(raw <= adjusted <= 1.0 for raw, adjusted in zip(p, found, strict=True))
    ordered = [found[i] for i in sorted(range(len(p)), key=p.__getitem__)]
    assert ordered == sorted(ordered)
    assert all(a <= min(1.0, len(p) * raw) + 1e-15 for raw, a in zip(p, found, strict=True)), "never above Bonferroni"
