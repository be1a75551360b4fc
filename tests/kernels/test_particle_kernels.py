"""Weights, moments, resampling and allocation of particles."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import floor

import numpy as np
import pytest

from wsnsim.kernels.particles import allocate, moments, systematic, weigh

OFFSETS = np.array([0, 5, 5, 17, 40])


def normalised(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def test_weights_get_mean_one_and_their_effective_number_per_segment() -> None:
    log_weights = np.random.default_rng(1).normal(0.0, 30.0, 40) - 5000.0
    given = log_weights.copy()
    effective = weigh(log_weights, OFFSETS)
    for m, (first, last) in enumerate(pairwise(OFFSETS.tolist())):
        if first == last:
            assert effective[m] == 0.0
            continue
        shares = normalised(given[first:last])
        assert np.exp(log_weights[first:last]) == pytest.approx(shares * (last - first), rel=1e-9, abs=1e-290)
        assert effective[m] == pytest.approx(1.0 / np.sum(shares**2), rel=1e-9)


@pytest.mark.parametrize("hopeless", [[-np.inf] * 3, [np.nan] * 3, [-np.inf, np.nan, -np.inf], [0.0, np.inf, 0.0]])
def test_where_nothing_can_be_weighed_weights_are_equal_and_none_is_effective(hopeless: list[float]) -> None:
    log_weights = np.array(hopeless)
    assert weigh(log_weights, np.array([0, 3])) == pytest.approx([0.0])
    assert log_weights.tolist() == [0.0, 0.0, 0.0]


def test_a_weight_that_is_not_a_number_counts_as_none() -> None:
    log_weights = np.array([0.0, np.nan, 0.0])
    assert weigh(log_weights, np.array([0, 3])) == pytest.approx([2.0])
    assert log_weights == pytest.approx([np.log(1.5), -np.inf, np.log(1.5)])


def test_moments_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    cloud, log_weights = rng.normal(3.0, 5.0, (4, 40)), rng.normal(0.0, 2.0, 40)
    means, covs = moments(cloud, log_weights, OFFSETS)
    for m, (first, last) in enumerate(pairwise(OFFSETS.tolist())):
        if first == last:
            assert not means[m].any() and not covs[m].any()
            continue
        shares = normalised(log_weights[first:last])
        assert means[m] == pytest.approx(cloud[:, first:last] @ shares, rel=1e-9)
        assert covs[m] == pytest.approx(np.cov(cloud[:, first:last], aweights=shares, ddof=0), rel=1e-9)


def test_a_particle_without_weight_may_be_anything() -> None:
    cloud = np.array([[1.0, 3.0, np.nan, np.inf]])
    means, covs = moments(cloud, np.array([0.0, 0.0, -np.inf, -np.inf]), np.array([0, 4]))
    assert (means[0, 0], covs[0, 0, 0]) == pytest.approx((2.0, 1.0))


def test_systematic_resampling_draws_each_particle_floor_or_ceiling_of_its_expected_number() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        log_weights = rng.normal(0.0, 2.0, 60)
        expected = 100 * normalised(log_weights)
        chosen = systematic(log_weights, np.array([0, 60]), np.array([100]), rng.random(1))
        counts = np.bincount(chosen, minlength=60)
        assert counts.sum() == 100
        assert np.all(counts >= np.floor(expected - 1e-9)) and np.all(counts <= np.ceil(expected + 1e-9))


def test_systematic_resampling_is_unbiased() -> None:
    log_weights = np.random.default_rng(4).normal(0.0, 1.5, 30)
    starts = (np.arange(4000) + 0.5) / 4000
    counts = np.zeros(30)
    for start in starts:
        drawn = systematic(log_weights, np.array([0, 30]), np.array([25]), np.array([start]))
        counts += np.bincount(drawn, minlength=30)
    assert counts / 4000 == pytest.approx(25 * normalised(log_weights), abs=2.0 / 4000)


def test_resampling_never_draws_what_has_no_weight() -> None:
    log_weights = np.array([-np.inf, 0.0, -np.inf, 1.0, -np.inf])
    for start in (0.0, 0.3, 1.0 - 2.0**-53):
        chosen = systematic(log_weights, np.array([0, 5]), np.array([7]), np.array([start]))
        assert set(chosen.tolist()) == {1, 3}


def test_segments_are_resampled_apart() -> None:
    log_weights = np.random.default_rng(5).normal(size=40)
    sizes, starts = np.array([5, 0, 30, 11]), np.array([0.1, 0.2, 0.3, 0.4])
    together = systematic(log_weights, OFFSETS, sizes, starts)
    alone = [
        first
        + systematic(log_weights[first:last].copy(), np.array([0, last - first]), sizes[m : m + 1], starts[m : m + 1])
        for m, (first, last) in enumerate(pairwise(OFFSETS.tolist()))
        if last > first
    ]
    assert together.tolist() == np.concatenate(alone).tolist()


@pytest.mark.thorough
def test_shares_sum_to_the_total_and_differ_by_one_at_most_for_every_number_of_particles_and_members() -> None:
    for active in range(1, 61):
        shares = np.array([allocate(total, active) for total in range(2001)])
        assert np.array_equal(shares.sum(axis=1), np.arange(2001))
        assert np.all(shares.max(axis=1) - shares.min(axis=1) <= 1)
        assert np.all(np.diff(shares, axis=1) >= 0)


def test_shares_follow_the_printed_recursion() -> None:
    for total, active in ((400, 17), (7, 3), (2, 5), (0, 4), (1600, 59)):
        dealt, expected = 0, []
        for i in range(1, active + 1):
            expected.append(floor(Fraction(total - dealt, active - (i - 1))))
            dealt += expected[-1]
        assert allocate(total, active).tolist() == expected


def test_nobody_gets_nothing() -> None:
    assert allocate(400, 0).size == 0
