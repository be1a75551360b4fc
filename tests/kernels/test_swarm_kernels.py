"""The swarm's move and its test, by hand and on densities that are known."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.base.rng import derive_all, uniforms
from wsnsim.kernels.swarm import accept, fly

KEYS = derive_all(5, np.arange(6))
OFFSETS = np.array([0, 2, 2, 6])


def test_a_move_follows_equations_18_and_19_with_each_particles_own_uniforms() -> None:
    rng = np.random.default_rng(1)
    cloud, velocity, best = rng.normal(size=(3, 2, 6))
    fitness = np.array([0.0, 1.0, 4.0, 9.0, -1.0, 2.0])
    draw, phi1, phi2, length = 10, 2.0, 1.5, 0.04
    new_velocity = velocity.copy()
    proposal = fly(cloud, new_velocity, best, fitness, OFFSETS, KEYS, draw, 0.7, phi1, phi2, length, True)
    for j, leader in enumerate((1, 1, 3, 3, 3, 3)):
        for d in range(2):
            r1, r2 = (uniforms(KEYS[j : j + 1], draw + 2 * d + k)[0] for k in (0, 1))
            v = (
                0.7 * velocity[d, j]
                + phi1 * r1 * (best[d, j] - cloud[d, j])
                + phi2 * r2 * (best[d, leader] - cloud[d, j])
            )
            assert new_velocity[d, j] == pytest.approx(v, rel=1e-12)
            assert proposal[d, j] == pytest.approx(cloud[d, j] + v * length, rel=1e-12)


def test_without_random_factors_and_with_a_step_of_one_the_move_swings_up() -> None:
    cloud, velocity, best = np.ones((1, 1)), np.zeros((1, 1)), np.zeros((1, 1))
    path = []
    for _ in range(6):
        cloud = fly(cloud, velocity, best, np.zeros(1), np.array([0, 1]), KEYS[:1], 0, 1.0, 2.0, 2.0, 1.0, False)
        path.append(cloud[0, 0])
    assert path == pytest.approx([-3.0, 5.0, -7.0, 9.0, -11.0, 13.0])


def test_acceptance_follows_equations_20_to_24() -> None:
    rng = np.random.default_rng(2)
    cloud, proposal, best = rng.normal(size=(3, 2, 6))
    fitness, prior, new_fitness, new_prior = rng.normal(size=(4, 6))
    best_fitness = fitness + rng.uniform(0.0, 0.5, 6)
    limits = np.log(uniforms(KEYS, 7 + 4))
    taken = limits < np.minimum(new_fitness + new_prior - fitness - prior, 0.0)
    expected = np.where(taken, proposal, cloud)
    expected_fitness = np.where(taken, new_fitness, fitness)
    improved = expected_fitness > best_fitness
    expected_best = np.where(improved, expected, best)
    assert 0 < taken.sum() < 6 and 0 < improved.sum() < 6, "the case must show both outcomes"
    accepted = accept(cloud, fitness, prior, proposal, new_fitness, new_prior, best, best_fitness, KEYS, 7)
    assert accepted == taken.sum()
    assert np.array_equal(cloud, expected) and np.array_equal(fitness, expected_fitness)
    assert np.array_equal(best, expected_best)


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_an_impossible_proposal_is_refused_even_from_an_impossible_place(value: float) -> None:
    cloud, best = np.zeros((1, 2)), np.zeros((1, 2))
    fitness = np.array([0.0, -np.inf])
    accepted = accept(
        cloud,
        fitness,
        np.zeros(2),
        np.ones((1, 2)),
        np.full(2, value),
        np.zeros(2),
        best,
        fitness.copy(),
        KEYS[:2],
        0,
    )
    assert accepted == 0 and not cloud.any()


def test_chains_with_a_symmetric_proposal_settle_on_the_product_of_likelihood_and_prior() -> None:
    chains, rng = 20_000, np.random.default_rng(3)
    keys = derive_all(11, np.arange(chains))
    cloud = np.full((1, chains), 4.0)
    best, best_fitness = cloud.copy(), np.full(chains, -np.inf)

    def likelihood(x: np.ndarray) -> np.ndarray:
        return -0.5 * (x[0] - 1.0) ** 2 / 0.5

    def prior(x: np.ndarray) -> np.ndarray:
        return -0.5 * x[0] ** 2 / 2.0

    fitness, log_prior = likelihood(cloud), prior(cloud)
    for iteration in range(60):
        proposal = cloud + rng.normal(0.0, 1.5, cloud.shape)
        new = likelihood(proposal), prior(proposal)
        accept(cloud, fitness, log_prior, proposal, *new, best, best_fitness, keys, 3 * iteration)
    # N(1, 0.5) times N(0, 2) is N(0.8, 0.4)
    assert cloud.mean() == pytest.approx(0.8, abs=4.0 * np.sqrt(0.4 / chains))
    assert cloud.var() == pytest.approx(0.4, abs=4.0 * 0.4 * np.sqrt(2.0 / chains))
    inside = np.mean(np.abs(cloud - 0.8) < np.sqrt(0.4))
    assert inside == pytest.approx(0.6827, abs=4.0 * np.sqrt(0.6827 * 0.3173 / chains))


def test_a_proposal_too_far_to_be_a_place_is_refused() -> None:
    cloud, fitness = np.zeros((2, 2)), np.zeros(2)
    proposal = np.array([[1.0, 1.0], [-2e9, 3.0]])
    accepted = accept(
        cloud, fitness, np.zeros(2), proposal, np.ones(2), np.zeros(2), cloud.copy(), np.zeros(2), KEYS[:2], 0
    )
    assert accepted == 1 and cloud.tolist() == [[0.0, 1.0], [0.0, 3.0]]
