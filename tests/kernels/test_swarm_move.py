"""The whole move of some members' swarms in one call, against the move of one member after the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.bench import twins
from tests.bench.entries import ENTRIES, copies
from wsnsim.kernels.swarm_move import move_own

MOVE = next(entry for entry in ENTRIES if entry.kernel == "swarm_move.move_own").arguments
CLOUD, LOG_WEIGHTS, OFFSETS, MOVING, PULL, RANKED = 0, 1, 4, 5, 14, 15
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
    return (mine[CLOUD] != arguments[CLOUD]).any(axis=0), np.repeat(arguments[MOVING], np.diff(arguments[OFFSETS]))


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
    mine = slice(*alone[OFFSETS][5:7])
    assert np.array_equal(alone[CLOUD][:, mine], all_of_them[CLOUD][:, mine])
    assert not alone[LOG_WEIGHTS][mine].any() and alone[LOG_WEIGHTS].any()
