"""The gravitational move: by hand, against NumPy, and where masses, distances or places fail."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.base.rng import GOLDEN, derive_all, uniforms
from wsnsim.kernels.gravity import attract

EPSILON = 1e-6
PLACES = np.array([0, 1])


def attract_twin(points, velocities, fitness, places, keys, draw, gravity, elite, softening):
    """Eqs. (5)-(9) on whole arrays: pulls (N, N) of column j on row i."""
    count = fitness.size
    fit = np.where(np.isfinite(fitness), np.exp(fitness - fitness[np.isfinite(fitness)].max()), 0.0)
    masses = (fit - fit.min()) / (fit.max() - fit.min())
    masses /= masses.sum()
    heavy = np.argsort(-masses, kind="stable")[:elite]
    between = points[:, None, :] - points[:, :, None]
    distances = np.sqrt((between[places] ** 2).sum(axis=0))
    rand = uniforms(keys[:, None] + np.arange(count, dtype=np.uint64) * np.uint64(GOLDEN), draw + 1)  # of (i, j)
    pulls = gravity * rand * masses / (distances + softening)
    accelerations = (pulls[:, heavy] * between[:, :, heavy]).sum(axis=-1)
    velocities[:] = uniforms(keys, draw) * velocities + accelerations
    return points + velocities


def keys_for(count: int) -> np.ndarray:
    return derive_all(23, np.arange(count))


def swarm(count: int, rows: int = 4, seed: int = 1) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    return *rng.normal(size=(2, rows, count)), rng.normal(-900.0, 3.0, count), keys_for(count)


def test_three_particles_fall_as_written_out() -> None:
    """Fitness 4 : 2 : 1 in one iteration with G = 2: m = (1, 1/3, 0), M = (3/4, 1/4, 0)."""
    points = np.array([[0.0, 3.0, 0.0], [0.0, 4.0, 2.0]])
    velocities = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
    fitness = np.log([4.0, 2.0, 1.0]) - 5000.0
    keys, draw = keys_for(3), 8
    last = uniforms(keys, draw)
    r = [uniforms(keys[i : i + 1], draw + 1 + j)[0] for i, j in ((0, 1), (1, 0), (2, 0), (2, 1))]
    found = attract(points, velocities, fitness, PLACES, keys, draw, 2.0, 3, EPSILON)
    third = 2.0 * r[2] * 0.75 / (2.0 + EPSILON), 2.0 * r[3] * 0.25 / (np.sqrt(13.0) + EPSILON)
    expected = np.array(
        [
            [
                last[0] * 1.0 + 2.0 * r[0] * 0.25 / (5.0 + EPSILON) * 3.0,
                2.0 * r[1] * 0.75 / (5.0 + EPSILON) * -3.0,
                last[2] * 2.0 + third[0] * 0.0 + third[1] * 3.0,
            ],
            [
                2.0 * r[0] * 0.25 / (5.0 + EPSILON) * 4.0,
                last[1] * 1.0 + 2.0 * r[1] * 0.75 / (5.0 + EPSILON) * -4.0,
                third[0] * -2.0 + third[1] * 2.0,
            ],
        ]
    )
    assert velocities == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert found == pytest.approx(points + expected, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize(("rows", "places"), [(1, [0]), (2, [0, 1]), (4, [0, 2]), (3, [2])])
@pytest.mark.parametrize("elite", [1, 2, 17, 40])
def test_a_move_is_that_of_the_twin(rows: int, places: list[int], elite: int) -> None:
    points, velocities, fitness, keys = swarm(40, rows)
    fitness[[3, 8]] = -np.inf, np.nan
    twins = velocities.copy()
    arguments = fitness, np.array(places), keys, 41, 13.5, elite, EPSILON
    expected = attract_twin(points, twins, *arguments)
    assert attract(points, velocities, *arguments) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert velocities == pytest.approx(twins, rel=1e-9, abs=1e-9)


def test_many_moves_stay_with_the_twin() -> None:
    points, velocities, _, keys = swarm(25, 2)
    twin_points, twin_velocities = points.copy(), velocities.copy()
    for t in range(10):
        rule = PLACES, keys, 26 * t, 3.0, 25 - 2 * t, EPSILON
        points = attract(points, velocities, -0.5 * (points**2).sum(axis=0), *rule)
        twin_points = attract_twin(twin_points, twin_velocities, -0.5 * (twin_points**2).sum(axis=0), *rule)
    assert points == pytest.approx(twin_points, rel=1e-9, abs=1e-9)


def test_the_worst_particle_has_no_mass_and_falls_all_the_same() -> None:
    points, velocities = np.array([[0.0, 1.0]]), np.zeros((1, 2))
    found = attract(points, velocities, np.array([-3.0, 0.0]), np.array([0]), keys_for(2), 0, 0.5, 2, EPSILON)
    pull = 0.5 * uniforms(keys_for(2)[:1], 2)[0] / (1.0 + EPSILON)
    assert found[0, 0] == pytest.approx(pull, rel=1e-12), "M_i is cancelled: a mass of zero is no division by zero"
    assert found[0, 1] == 1.0, "the worst pulls nobody"


@pytest.mark.parametrize("same", [0.0, -1e6, -np.inf, np.nan, np.inf])
def test_where_all_are_as_fit_all_have_the_same_mass(same: float) -> None:
    points, velocities = np.array([[0.0, 2.0, 5.0]]), np.zeros((1, 3))
    keys = keys_for(3)
    found = attract(points, velocities, np.full(3, same), np.array([0]), keys, 0, 1.0, 3, EPSILON)
    first = sum(uniforms(keys[:1], 1 + j)[0] / 3.0 for j in (1, 2))
    assert found[0, 0] == pytest.approx(first, rel=1e-5)


@pytest.mark.parametrize("softening", [EPSILON, 0.0])
def test_particles_in_one_place_do_not_pull_each_other_even_without_softening(softening: float) -> None:
    points, velocities = np.full((2, 4), 3.0), np.ones((2, 4))
    keys = keys_for(4)
    found = attract(points, velocities, np.arange(4.0), PLACES, keys, 0, 100.0, 4, softening)
    assert found == pytest.approx(np.tile(3.0 + uniforms(keys, 0), (2, 1)), rel=1e-12)


def test_a_fitness_that_is_no_number_is_as_bad_as_minus_infinity() -> None:
    results = []
    for none in (-np.inf, np.nan, np.inf):
        points, velocities, fitness, keys = swarm(6, 2)
        fitness[2] = none
        results.append(attract(points, velocities, fitness, PLACES, keys, 0, 5.0, 6, EPSILON))
    assert np.all(np.isfinite(results[0]))
    assert np.array_equal(results[0], results[1]) and np.array_equal(results[0], results[2])


@pytest.mark.parametrize("lost", [np.nan, np.inf, -2e9])
def test_a_particle_that_is_nowhere_stays_there_and_pulls_nobody(lost: float) -> None:
    points, velocities, fitness, keys = swarm(6, 2)
    others = [0, 1, 3, 4, 5]
    points[1, 2] = lost
    fitness[2] = 0.0
    with_it = attract(points, velocities, fitness, PLACES, keys, 0, 5.0, 6, EPSILON)
    assert np.array_equal(with_it[:, 2], points[:, 2], equal_nan=True) and not velocities[:, 2].any()
    points, velocities, _, _ = swarm(6, 2)  # it had all the mass there is, and nobody felt it
    drift = uniforms(keys[others], 0) * velocities[:, others]
    assert with_it[:, others] == pytest.approx(points[:, others] + drift, rel=1e-12)


def test_a_particle_that_would_be_thrown_beyond_any_place_stays_and_stops() -> None:
    points, velocities = np.array([[0.0, 1.0], [0.0, 1e8]]), np.zeros((2, 2))
    found = attract(points, velocities, np.array([0.0, 1.0]), np.array([0]), keys_for(2), 0, 1e6, 2, EPSILON)
    assert np.array_equal(found, points) and not velocities.any()


def test_only_the_elite_pulls_and_of_equals_the_first() -> None:
    """Four on a line, the two in the middle equally fit: with an elite of two, the later of them waits."""
    points, keys = np.array([[0.0, 10.0, 20.0, 30.0]]), keys_for(4)
    fitness = np.log([4.0, 2.0, 2.0, 1.0])
    masses = np.array([3.0, 1.0, 1.0, 0.0]) / 5.0
    for elite, pulling in ((1, [0]), (2, [0, 1]), (3, [0, 1, 2]), (4, [0, 1, 2]), (0, [0]), (9, [0, 1, 2])):
        found = attract(points, np.zeros((1, 4)), fitness, np.array([0]), keys, 0, 1.0, elite, EPSILON)
        fall = [
            sum(uniforms(keys[i : i + 1], 1 + j)[0] * masses[j] * np.sign(j - i) for j in pulling) for i in range(4)
        ]
        assert found - points == pytest.approx(np.array([fall]), abs=1e-6)


def test_the_chosen_are_those_of_a_sort_whatever_the_masses() -> None:
    """The choice without a sort, on fitnesses with many ties: a twin that sorts agrees."""
    rng = np.random.default_rng(9)
    for _ in range(200):
        count = int(rng.integers(2, 30))
        fitness = rng.integers(0, 4, count).astype(float)
        fitness[:2] = 0.0, 4.0
        points, keys, elite = rng.normal(size=(2, count)), keys_for(count), int(rng.integers(1, count + 1))
        velocities, twins = np.zeros((2, count)), np.zeros((2, count))
        found = attract(points, velocities, fitness, PLACES, keys, 0, 1.0, elite, EPSILON)
        assert found == pytest.approx(
            attract_twin(points, twins, fitness, PLACES, keys, 0, 1.0, elite, EPSILON), rel=1e-9, abs=1e-9
        )


def test_a_lone_particle_keeps_on_by_its_own_velocity() -> None:
    points, velocities, keys = np.array([[1.0]]), np.array([[2.0]]), keys_for(1)
    found = attract(points, velocities, np.array([-5.0]), np.array([0]), keys, 3, 100.0, 1, EPSILON)
    assert found[0, 0] == pytest.approx(1.0 + 2.0 * uniforms(keys, 3)[0], rel=1e-12)
