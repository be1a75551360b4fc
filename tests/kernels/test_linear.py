"""The linear motion's kernels against NumPy's matrix products and SciPy's normal density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wsnsim.base import rng
from wsnsim.kernels.linear import advance, log_transition, propagate

COUNT = 300
SHAPES = [(1, 1), (3, 1), (4, 2), (4, 3), (4, 4), (5, 5)]


def normal_pair_twin(keys: np.ndarray, pair: int) -> np.ndarray:
    """(2, N): Box-Muller on the uniforms 2 pair and 2 pair + 1 of each key."""
    radius = np.sqrt(-2.0 * np.log1p(-rng.uniforms(keys, 2 * pair)))
    angle = 2.0 * np.pi * rng.uniforms(keys, 2 * pair + 1)
    return radius * np.array([np.cos(angle), np.sin(angle)])


def advance_twin(states: np.ndarray, transition: np.ndarray) -> np.ndarray:
    return transition @ states


def propagate_twin(states: np.ndarray, keys: np.ndarray, transition: np.ndarray, root: np.ndarray) -> np.ndarray:
    inputs = root.shape[1]
    white = np.concatenate([normal_pair_twin(keys, pair) for pair in range((inputs + 1) // 2)])
    return transition @ states + root @ white[:inputs]


def log_transition_twin(
    after: np.ndarray, before: np.ndarray, transition: np.ndarray, factor: np.ndarray
) -> np.ndarray:
    white = np.linalg.solve(factor, after - transition @ before)
    return -0.5 * (len(factor) * np.log(2.0 * np.pi) + (white**2).sum(axis=0)) - np.log(np.diag(factor)).sum()


def some(columns: int, inputs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """States, keys, F with zeros in it, and a lower triangular L."""
    draw = np.random.default_rng(columns + inputs)
    transition = np.triu(draw.normal(size=(columns, columns)))
    root = np.tril(draw.normal(size=(columns, inputs)), -1) + np.eye(columns, inputs) * draw.uniform(0.5, 3.0, inputs)
    return draw.normal(0.0, 30.0, (columns, COUNT)), rng.derive_all(3, np.arange(COUNT)), transition, root


@pytest.mark.parametrize(("columns", "inputs"), SHAPES)
def test_states_move_as_the_matrices_say_with_the_noise_of_their_keys(columns: int, inputs: int) -> None:
    states, keys, transition, root = some(columns, inputs)
    assert np.allclose(advance(states, transition), advance_twin(states, transition), atol=1e-11, rtol=0)
    moved = propagate_twin(states, keys, transition, root)
    assert np.allclose(propagate(states, keys, transition, root), moved, atol=1e-9, rtol=0)


def test_noise_without_inputs_is_none() -> None:
    states, keys, transition, _ = some(4, 4)
    assert np.array_equal(propagate(states, keys, transition, np.empty((4, 0))), advance(states, transition))


@pytest.mark.parametrize("columns", [1, 2, 4, 5])
def test_the_transition_density_is_the_multivariate_normal(columns: int) -> None:
    before, keys, transition, factor = some(columns, columns)
    after = propagate_twin(before, keys, transition, factor)
    found = log_transition(after, before, transition, factor)
    assert np.allclose(found, log_transition_twin(after, before, transition, factor), atol=1e-9, rtol=0)
    spread = multivariate_normal(cov=factor @ factor.T)
    assert np.allclose(found, spread.logpdf((after - transition @ before).T), atol=1e-8, rtol=0)


@pytest.mark.parametrize("pivot", [0.0, -1.0, np.nan])
def test_a_factor_that_is_none_makes_every_step_impossible(pivot: float) -> None:
    before, keys, transition, factor = some(4, 4)
    after = propagate(before, keys, transition, factor)
    factor[2, 2] = pivot
    assert np.all(np.isneginf(log_transition(after, before, transition, factor)))


def test_the_density_asks_for_states_and_leaves_them_as_they_are() -> None:
    before, keys, transition, factor = some(4, 4)
    after = propagate(before, keys, transition, factor)
    kept = after.copy(), before.copy()
    log_transition(after, before, transition, factor)
    assert np.array_equal(after, kept[0])
    assert np.array_equal(before, kept[1])


def test_a_particle_moves_alike_in_any_company() -> None:
    states, keys, transition, root = some(4, 3)
    order = np.random.default_rng(2).permutation(COUNT)
    together = propagate(states, keys, transition, root)
    shuffled = propagate(np.ascontiguousarray(states[:, order]), keys[order], transition, root)
    alone = propagate(np.ascontiguousarray(states[:, 7:8]), keys[7:8], transition, root)
    assert np.allclose(shuffled, together[:, order], rtol=1e-13, atol=1e-13)
    assert np.allclose(alone[:, 0], together[:, 7], rtol=1e-13, atol=1e-13)


def test_states_that_are_not_finite_are_impossible_and_hurt_nobody_else() -> None:
    states, keys, transition, root = some(4, 4)
    clean = propagate(states, keys, transition, root)
    density = log_transition(clean, states, transition, root)
    states[0, 5], states[1, 6], states[3, 7] = np.nan, np.inf, -np.inf
    broken = propagate(states, keys, transition, root)
    untouched = np.setdiff1d(np.arange(COUNT), [5, 6, 7, 8])
    assert np.array_equal(broken[:, untouched], clean[:, untouched])
    for after in (clean.copy(), broken):
        after[2, 8] = 1e200
        found = log_transition(after, states, transition, root)
        assert np.all(np.isneginf(found[5:9]))
        assert np.array_equal(found[untouched], density[untouched])
