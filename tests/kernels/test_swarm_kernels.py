"""The swarm move step by step, and the whole move in one call."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.bench import twins
from tests.bench.entries import ENTRIES, copies
from wsnsim.base.rng import derive_all, uniforms
from wsnsim.kernels.swarm import accept, fly, move_own

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


MOVE = next(entry for entry in ENTRIES if entry.kernel == "swarm.move_own").arguments
CLOUD, LOG_WEIGHTS, OFFSETS_AT, MOVING, PULL, RANKED = 0, 1, 4, 5, 14, 15
"""Places of arguments."""


def move_own_twin(
    cloud, log_weights, carried, fitness, offsets, moving, log_counts, keys, readings, positions, gains, law, place,
    tag, pull, ranked, ridge,
):  # fmt: skip
    for m in np.flatnonzero(moving):
        mine = slice(offsets[m], offsets[m + 1])
        count = offsets[m + 1] - offsets[m]
        segment, owners = np.array([0, count]), np.zeros(count, np.int64)
        sensor = readings[m : m + 1], positions[m : m + 1], gains[m : m + 1], owners, law
        fitted = twins.fit_weighted(cloud[:, mine], carried[mine], segment, ridge)
        ranks = log_weights[mine] - log_counts[m] if ranked else fitness[mine].copy()
        own, fit = twins.particle_keys(keys[m : m + 1], segment, tag), fitness[mine].copy()
        some, velocity = cloud[:, mine].copy(), np.zeros((len(cloud), count))
        best, prior = some.copy(), twins.log_density(some, *fitted, segment)
        for iteration in range(pull[0]):
            draw = 9 * iteration
            proposal = twins.fly(some, velocity, best, ranks, segment, own, draw, 1.0, *pull[1:])
            new_fitness = twins.own_log_likelihood(proposal[place[0]], proposal[place[1]], *sensor)
            new_prior = twins.log_density(proposal, *fitted, segment)
            twins.accept(some, fit, prior, proposal, new_fitness, new_prior, best, ranks, own, draw)
        cloud[:, mine], log_weights[mine] = some, 0.0


def agreed(arguments: tuple[Any, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Demand the same cloud and weights afterwards; return which particles moved, and which are of those that may."""
    mine, theirs = copies(arguments), copies(arguments)
    move_own(*mine)
    move_own_twin(*theirs)
    for found, expected in zip(mine, theirs, strict=True):
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-9)
    return (mine[CLOUD] != arguments[CLOUD]).any(axis=0), np.repeat(arguments[MOVING], np.diff(arguments[OFFSETS_AT]))


CHANGES: list[dict[int, Any]] = [
    {},
    {RANKED: False},
    {PULL: (3, 1.5, 0.5, 0.04, True)},
    {PULL: (1, 1.0, 0.5, 1.0, False)},
]


@pytest.mark.parametrize("changes", CHANGES)
def test_the_swarms_that_move_do_so_as_one_after_the_other_and_the_others_stay(changes: dict[int, Any]) -> None:
    moved, may = agreed(tuple(changes.get(place, value) for place, value in enumerate(MOVE(397))))
    assert moved.any() and not moved[~may].any()


def test_without_iterations_a_move_only_makes_the_weights_equal() -> None:
    arguments = tuple({PULL: (0, 2.0, 2.0, 1.0, True)}.get(place, value) for place, value in enumerate(MOVE(100)))
    moved, may = agreed(arguments)
    assert not moved.any() and may.any()


@pytest.mark.parametrize("everybody", [True, False])
def test_everybody_moves_or_nobody(everybody: bool) -> None:
    arguments = tuple({MOVING: np.full(8, everybody)}.get(place, value) for place, value in enumerate(MOVE(100)))
    assert agreed(arguments)[0].any() == everybody


def test_what_a_member_gets_does_not_depend_on_who_else_moves() -> None:
    alone, all_of_them = copies(MOVE(200)), copies(MOVE(200))
    alone[MOVING][:], all_of_them[MOVING][:] = np.arange(8) == 5, True
    move_own(*alone)
    move_own(*all_of_them)
    mine = slice(*alone[OFFSETS_AT][5:7])
    assert np.array_equal(alone[CLOUD][:, mine], all_of_them[CLOUD][:, mine])
    assert not alone[LOG_WEIGHTS][mine].any() and alone[LOG_WEIGHTS].any()
