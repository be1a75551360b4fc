"""The growth model's kernels against the printed equations in NumPy, and against SciPy's normal density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from wsnsim.base import rng
from wsnsim.kernels import ungm

COUNT, LAW, TIME, VARIANCE = 300, (1.2, 1.5), 7.0, 0.8
Law = tuple[float, float]


def advance_twin(states: np.ndarray, law: Law, time: float) -> np.ndarray:
    return states / 2 + 25 * states / (1 + states**2) + 8 * np.cos(law[0] * time)


def propagate_twin(states: np.ndarray, keys: np.ndarray, law: Law, time: float) -> np.ndarray:
    return advance_twin(states, law, time) + law[1] * rng.normals(keys, 0)


def log_transition_twin(after: np.ndarray, before: np.ndarray, law: Law, time: float) -> np.ndarray:
    white = (after - advance_twin(before, law, time))[0] / law[1]
    return -0.5 * (white**2 + np.log(2 * np.pi)) - np.log(law[1])


def joint_log_likelihood_twin(x: np.ndarray, readings: np.ndarray, variance: float) -> np.ndarray:
    return -0.5 * ((readings[:, None] - x**2 / 20) ** 2 / variance + np.log(2 * np.pi * variance)).sum(axis=0)


def own_log_likelihood_twin(x: np.ndarray, readings: np.ndarray, owners: np.ndarray, variance: float) -> np.ndarray:
    return -0.5 * ((readings[owners] - x**2 / 20) ** 2 / variance + np.log(2 * np.pi * variance))


def some_states() -> tuple[np.ndarray, np.ndarray]:
    states = np.random.default_rng(1).normal(0.0, 12.0, (1, COUNT))
    states[0, :3] = 0.0, 1.0, -1.0
    return states, rng.derive_all(5, np.arange(COUNT))


def test_a_step_is_the_one_reckoned_by_hand() -> None:
    """2/2 + 25·2/5 = 11, pushed by 8 cos(1.2·3) = -7.174067; the state 0 is pushed only."""
    moved = ungm.advance(np.array([[2.0, 0.0, -2.0]]), LAW, 3.0)
    assert moved[0] == pytest.approx([11 - 7.174067, -7.174067, -11 - 7.174067], abs=1e-6)


def test_states_move_as_printed_with_the_noise_of_their_keys() -> None:
    states, keys = some_states()
    assert np.allclose(ungm.advance(states, LAW, TIME), advance_twin(states, LAW, TIME), atol=1e-9, rtol=0)
    moved = propagate_twin(states, keys, LAW, TIME)
    assert np.allclose(ungm.propagate(states, keys, LAW, TIME), moved, atol=1e-9, rtol=0)


def test_the_transition_density_is_the_normal() -> None:
    before, keys = some_states()
    after = propagate_twin(before, keys, LAW, TIME)
    found = ungm.log_transition(after, before, LAW, TIME)
    truth = norm.logpdf(after[0], advance_twin(before, LAW, TIME)[0], LAW[1])
    assert np.allclose(found, truth, atol=1e-9, rtol=0)
    assert np.allclose(found, log_transition_twin(after, before, LAW, TIME), atol=1e-9, rtol=0)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_the_joint_likelihood_is_the_sum_of_normal_log_densities(count: int) -> None:
    x, readings = some_states()[0][0], np.random.default_rng(2).normal(5.0, 4.0, count)
    truth = norm.logpdf(readings[:, None], x**2 / 20, np.sqrt(VARIANCE)).sum(axis=0)
    found = ungm.joint_log_likelihood(x, readings, VARIANCE)
    assert np.allclose(found, truth, rtol=1e-9, atol=1e-9)
    assert np.allclose(found, joint_log_likelihood_twin(x, readings, VARIANCE), rtol=1e-9, atol=1e-9)


def test_a_particle_is_weighed_with_its_owners_reading_alone() -> None:
    x, readings = some_states()[0][0], np.random.default_rng(2).normal(5.0, 4.0, 6)
    owners = np.arange(COUNT) % 6
    truth = norm.logpdf(readings[owners], x**2 / 20, np.sqrt(VARIANCE))
    found = ungm.own_log_likelihood(x, readings, owners, VARIANCE)
    assert np.allclose(found, truth, rtol=1e-9, atol=1e-9)
    assert np.allclose(found, own_log_likelihood_twin(x, readings, owners, VARIANCE), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("stranger", [-1, 6])
def test_an_owner_without_a_reading_is_refused(stranger: int) -> None:
    x, owners = some_states()[0][0], np.full(COUNT, stranger)
    with pytest.raises(IndexError, match="not there"):
        ungm.own_log_likelihood(x, np.zeros(6), owners, VARIANCE)


def test_a_particle_moves_alike_in_any_company() -> None:
    states, keys = some_states()
    order = np.random.default_rng(2).permutation(COUNT)
    together = ungm.propagate(states, keys, LAW, TIME)
    shuffled = ungm.propagate(np.ascontiguousarray(states[:, order]), keys[order], LAW, TIME)
    alone = ungm.propagate(np.ascontiguousarray(states[:, 7:8]), keys[7:8], LAW, TIME)
    assert np.allclose(shuffled, together[:, order], rtol=1e-13, atol=1e-13)
    assert alone[0, 0] == pytest.approx(together[0, 7], rel=1e-13)


def test_states_that_are_not_finite_are_impossible_and_hurt_nobody_else() -> None:
    states, keys = some_states()
    clean, readings, owners = ungm.propagate(states, keys, LAW, TIME), np.array([1.0, 4.0]), np.arange(COUNT) % 2
    density = ungm.log_transition(clean, states, LAW, TIME)
    joint = ungm.joint_log_likelihood(states[0], readings, VARIANCE)
    own = ungm.own_log_likelihood(states[0], readings, owners, VARIANCE)
    states[0, 5:9] = np.nan, np.inf, -np.inf, 1e200
    untouched = np.setdiff1d(np.arange(COUNT), [5, 6, 7, 8])
    assert np.array_equal(ungm.propagate(states, keys, LAW, TIME)[:, untouched], clean[:, untouched])
    for found, before in (
        (ungm.log_transition(clean, states, LAW, TIME), density),
        (ungm.joint_log_likelihood(states[0], readings, VARIANCE), joint),
        (ungm.own_log_likelihood(states[0], readings, owners, VARIANCE), own),
    ):
        assert np.all(np.isneginf(found[5:9]))
        assert np.array_equal(found[untouched], before[untouched])
    nothing = ungm.joint_log_likelihood(states[0], np.empty(0), VARIANCE)
    assert np.flatnonzero(np.isneginf(nothing)).tolist() == [5, 6, 7]


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_reading_that_is_no_number_makes_every_state_impossible(broken: float) -> None:
    states, readings = some_states()[0], np.array([1.0, broken])
    assert np.all(np.isneginf(ungm.joint_log_likelihood(states[0], readings, VARIANCE)))
    own = ungm.own_log_likelihood(states[0], readings, np.arange(COUNT) % 2, VARIANCE)
    assert np.array_equal(np.isneginf(own), np.arange(COUNT) % 2 == 1)
