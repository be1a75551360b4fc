"""Posterior loads: neither the curse of the smallest value nor hidden hot spots, in synthetic networks."""

from __future__ import annotations

from typing import Final

import numpy as np
import pytest

from tests.helpers.thorough import THOROUGH
from wsnsim.lifetimes.rates import Loads, fit_loads

NODES, MEAN, QUIET = 100, 0.0127, 2.75e-4
BUSY: Final = {1: 0.01, 40: 0.26}
"""Visits an hour: largest bias of the first death, in synthetic networks of any kind, from 12 visits.

At 40 an hour, 12 visits cannot tell equal nodes from three hot ones: the bias of one is that of the other's prior.
"""


def loads_of(kind: str, rng: np.random.Generator) -> np.ndarray:
    """(N,) mean joules of a visit."""
    theta = np.exp(0.2 * rng.normal(size=NODES)) if kind == "smooth" else np.ones(NODES)
    if kind == "hot":
        theta[:3] = 2.5
    return MEAN * theta / theta.mean()


def visits_of(theta: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(K, N) visits that hit a fifth of the nodes each, and have a level of their own (variation about 2.4 a visit)."""
    level, hits = rng.gamma(7.0, 1 / 7, size=(count, 1)), rng.random((count, theta.size)) < 0.2
    return theta * level * hits / 0.2 * rng.gamma(5.0, 0.2, size=hits.shape)


def answers_of(kind: str, count: int, networks: int, per_hour: int) -> np.ndarray:
    """(networks, 4) bias of the first death, whether the intervals hold it and half dead, half width; as shares."""
    rng, rows = np.random.default_rng(5), []
    for _ in range(networks):
        theta = loads_of(kind, rng)
        drawn = fit_loads(visits_of(theta, count, rng)).draw(rng, 50)
        truth, lives = (1.0 / (QUIET + per_hour / 3600 * each) for each in (theta, drawn))
        (first, half), found = np.sort(truth)[[0, NODES // 2]], np.sort(lives, axis=1)[:, [0, NODES // 2]]
        (low, low_half), (high, high_half) = np.quantile(found, [0.025, 0.975], axis=0, method="weibull")
        rows.append((
            found[:, 0].mean() / first - 1.0, low <= first <= high, low_half <= half <= high_half,
            (high - low) / 2 / first,
        ))  # fmt: skip
    return np.array(rows, float)


@pytest.mark.parametrize("kind", ["equal", "smooth", "hot"])
@pytest.mark.parametrize("per_hour", BUSY)
@pytest.mark.parametrize("count", [12, pytest.param(48, marks=pytest.mark.thorough)])
def test_the_first_death_is_nearly_unbiased_and_intervals_hold_it(kind: str, per_hour: int, count: int) -> None:
    networks = 200 if THOROUGH else 15
    answers = answers_of(kind, count, networks, per_hour)
    bias, first, half, width = answers.mean(axis=0)
    error = np.sqrt(0.05 * 0.95 / networks)
    assert abs(bias) <= BUSY[per_hour] + 2.0 * answers[:, 0].std() / np.sqrt(networks)
    assert first >= 0.95 - 2.0 * error
    assert half >= 0.95 - 2.0 * error
    assert width <= (0.03 if per_hour == 1 else 0.5)


def test_more_visits_bring_the_first_death_nearer_and_narrow_its_interval() -> None:
    few, many = (answers_of("hot", count, 10, 40) for count in (12, 192))
    assert np.abs(many[:, 0]).mean() < 0.5 * np.abs(few[:, 0]).mean()
    assert many[:, 3].mean() < 0.5 * few[:, 3].mean()


def posterior_means(loads: Loads) -> np.ndarray:
    """(N,) the posterior mean load of each node."""
    by_prior = (loads.likelihood @ (loads.priors * loads.atoms).T) / (loads.likelihood @ loads.priors.T + 1e-300)
    means = by_prior @ loads.weights
    return loads.level * means / means.mean()


def test_equal_loads_are_known_to_be_equal_and_a_hot_spot_is_kept() -> None:
    rng = np.random.default_rng(2)
    theta = np.ones(NODES)
    theta[7] = 4.0
    loads = fit_loads(theta * rng.gamma(400.0, 1 / 400, size=(50, NODES)))
    means = posterior_means(loads)
    np.testing.assert_allclose(np.delete(means, 7), 1.0, rtol=0.03)
    assert means[7] == pytest.approx(4.0, rel=0.03)  # atoms are 2 % apart


def test_noise_that_neighbours_share_is_not_taken_for_hot_spots() -> None:
    rng, draws = np.random.default_rng(6), []
    for _ in range(10):  # groups of ten nodes are hit together
        samples = np.repeat(visits_of(np.full(NODES // 10, MEAN), 12, rng), 10, axis=1)
        draws.append(fit_loads(samples).draw(rng, 50).max(axis=1).mean() / MEAN)
    assert np.mean(draws) < 1.6  # the largest sample mean is 2.2 times the mean


def test_draws_have_the_level_of_the_visits() -> None:
    rng = np.random.default_rng(3)
    samples = visits_of(loads_of("smooth", rng), 48, rng)
    loads = fit_loads(samples)
    drawn = loads.draw(rng, 400).mean(axis=1)
    assert drawn.mean() == pytest.approx(samples.mean(), rel=0.02)
    assert drawn.std() / drawn.mean() == pytest.approx(loads.level_error, rel=0.2)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_visits_that_cost_nothing_have_no_loads(count: int) -> None:
    loads = fit_loads(np.zeros((count, 4)))
    np.testing.assert_array_equal(loads.draw(np.random.default_rng(0), 3), np.zeros((3, 4)))
