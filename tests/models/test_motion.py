"""The bounded-velocity model, and the check that a target starts within the field."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wsnsim import scenario
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.rng import derive_all
from wsnsim.models.motion import BoundedVelocity

T = 0.04
G = np.kron(np.eye(2), np.array([[T**2 / 2], [T]]))
Q = 0.002 * np.kron(np.eye(2), np.array([[T**3 / 2, T**2 / 2], [T**2 / 2, T]]))
COVARIANCES = {"both": G @ G.T + Q, "q_only": Q, "g_only": G @ G.T}


def transition(state):
    inner = np.array([[1, T], [0, 1]])
    outer = np.array([[1, T], [-T * 0.75, 1 - T * 1.0]])
    result = np.zeros((4, 4))
    result[:2, :2] = inner if abs(state[0]) <= 180 else outer
    result[2:, 2:] = inner if abs(state[2]) <= 180 else outer
    return result


def some_states(count=40):
    return np.random.default_rng(6).normal(0.0, 1.0, (4, count)) * np.array([[180.0], [30.0], [180.0], [30.0]])


@pytest.mark.parametrize("noise", COVARIANCES)
def test_the_matrices_are_those_of_the_equations(noise):
    states = some_states()
    transitions, covariance = BoundedVelocity(noise=noise).matrices(states, T)
    assert np.allclose(covariance, COVARIANCES[noise], rtol=1e-14, atol=0)
    assert np.allclose(transitions, [transition(state) for state in states.T], rtol=1e-15)


def test_advancing_applies_the_matrix():
    states = some_states()
    truth = np.stack([transition(state) @ state for state in states.T], axis=1)
    assert np.allclose(BoundedVelocity().advance(states, T), truth, rtol=1e-13)


@pytest.mark.parametrize("noise", COVARIANCES)
def test_the_noise_of_many_particles_has_the_covariance(noise):
    model, count = BoundedVelocity(noise=noise), 200_000
    states = np.tile([[10.0], [5.0], [-20.0], [3.0]], count)
    moved = model.propagate(states, T, derive_all(9, np.arange(count))) - model.advance(states, T)
    scale = np.sqrt(np.diag(COVARIANCES[noise]))
    found, wanted = np.cov(moved) / np.outer(scale, scale), COVARIANCES[noise] / np.outer(scale, scale)
    assert np.allclose(moved.mean(axis=1) / scale, 0.0, atol=0.01)
    assert np.allclose(found, wanted, atol=0.015)


@pytest.mark.parametrize("noise", ["both", "q_only"])
def test_the_transition_density_is_the_multivariate_normal(noise):
    model, states = BoundedVelocity(noise=noise), some_states()
    after = model.propagate(states, T, derive_all(10, np.arange(40)))
    truth = [
        multivariate_normal(transition(a) @ a, COVARIANCES[noise]).logpdf(b)
        for a, b in zip(states.T, after.T, strict=True)
    ]
    assert np.allclose(model.log_transition(after, states, T), truth, rtol=1e-7)


@pytest.mark.parametrize(
    "model", [BoundedVelocity(noise="g_only"), BoundedVelocity(q=0.0), BoundedVelocity(q=0.0, sigma0=0.0)]
)
def test_singular_noise_moves_particles_but_has_no_density(model):
    states = some_states()
    assert np.all(np.isfinite(model.propagate(states, T, derive_all(1, np.arange(40)))))
    with pytest.raises(RunError, match="singular"):
        model.log_transition(states, states, T)


def test_a_filter_may_assume_more_noise():
    assumed = BoundedVelocity().assumed(100.0)
    assert np.allclose(assumed.matrices(some_states(), T)[1], 100.0 * COVARIANCES["both"], rtol=1e-13)
    assert BoundedVelocity().assumed(1.0) == BoundedVelocity()


def test_the_truth_starts_at_the_start_and_keeps_to_the_model():
    model = BoundedVelocity()
    states = model.truth(3000, T, np.random.default_rng(3))
    assert states.shape == (3001, 4)
    assert tuple(states[0]) == model.start
    residuals = states[1:].T - model.advance(states[:-1].T, T)
    whitened = np.linalg.solve(np.linalg.cholesky(COVARIANCES["both"]), residuals)
    assert np.allclose(np.cov(whitened), np.eye(4), atol=0.12)  # 3000 draws: three standard errors of a variance
    assert np.max(np.abs(states[:, [0, 2]])) < 200.0


def test_a_longer_truth_begins_like_a_shorter_one():
    model = BoundedVelocity()
    short, long = (model.truth(steps, T, np.random.default_rng(3)) for steps in (50, 90))
    assert np.array_equal(short, long[:51])


def test_columns_of_a_larger_cloud_are_taken_as_they_are():
    model, states, keys = BoundedVelocity(), some_states(), derive_all(1, np.arange(40))
    assert np.allclose(
        model.propagate(states[:, 5:9], T, keys[5:9]), model.propagate(states, T, keys)[:, 5:9], rtol=1e-14
    )


def test_a_target_that_a_long_step_throws_out_is_an_error():
    """At 10 s a step the drag of 1/s turns the velocity round nine times over."""
    with pytest.raises(RunError, match="diverges"):
        BoundedVelocity().truth(1000, 10.0, np.random.default_rng(3))


OUTSIDE = {
    "bounded_velocity": {"start": [0, 0, 201, 0]},
    "constant_velocity": {"start": [0, 0, 201, 0]},
    "constant_acceleration": {"start": [201, 0, 0]},
}


def issues(*motions: dict, **changes) -> list[str]:
    source = scenario.resolved(scenario.load("jiang_field")) | changes
    del source["motion"]
    size = 3 if motions[-1]["kind"] == "constant_acceleration" else 4
    source |= {"targets": list(motions)} if len(motions) > 1 else {"motion": motions[0]}
    source["prior"] = {"sd": [1] * size}
    try:
        scenario.build(scenario.load(source))
    except ScenarioError as error:
        return str(error).splitlines()
    return []


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_start_outside_the_field_is_a_fault(kind: str) -> None:
    (issue,) = issues({"kind": kind, **OUTSIDE[kind]})
    assert issue.startswith("motion.start: error: (") and "outside the field of 400 m by 400 m around (0, 0)" in issue


def test_the_fault_is_that_of_the_target_which_it_concerns() -> None:
    inside = {"kind": "bounded_velocity", "start": [0, 0, 199, 0]}
    (issue,) = issues(inside, {"kind": "bounded_velocity", **OUTSIDE["bounded_velocity"]})
    assert issue.startswith("targets.1.start: error: ")


@pytest.mark.parametrize("kind", OUTSIDE)
def test_without_a_network_nobody_monitors_a_field(kind: str) -> None:
    assert issues({"kind": kind, **OUTSIDE[kind]}, network="none") == []
