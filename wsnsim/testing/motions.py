"""The contract check of motion models."""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.errors import RunError
from wsnsim.base.ports import MotionModel
from wsnsim.base.rng import derive_all
from wsnsim.testing.table import demand, examined

STEPS = 40
SAMPLES = 4000
ROUNDING = 1e-9
SIGMAS = 6.0
"""Standard errors by which a mean of samples may differ from its expectation: no seed fails by chance."""


def check_motion(motion: MotionModel, dt: float = 0.5, seed: int = 1) -> None:
    """Check a motion model against the rules of its port (`wsnsim.MotionModel`).

    Args:
        motion: An instance of the model.
        dt: Length of a step in s.
        seed: Seed of the trajectory and of all keys.

    Raises:
        AssertionError: The model breaks a rule, which the message names. columns: names, units and the position's
            columns fit together. truth: a finite trajectory of the right shape, the same for the same seed. shapes:
            states (D, N) stay (D, N), and arguments are not changed. keys: the noise of a particle is a function of
            its key alone. linearisation: `matrices` holds the derivative of `advance`, and a symmetric, positive
            semidefinite covariance. noise: `propagate` is `advance` on average. density: `log_transition` is a number
            or -inf, and greater for a likely successor than for an unlikely one. assumed: `assumed(4)` has four times
            the covariance.
    """
    motion = examined(motion, MotionModel)
    with demand("columns"):
        _check_columns(motion)
    with demand("truth"):
        truth = _checked_truth(motion, dt, seed)
    states = np.ascontiguousarray(truth[:: max(1, len(truth) // 8)].T)
    keys = derive_all(seed, np.arange(states.shape[1]))
    with demand("shapes"):
        _check_shapes(motion, states, dt, keys)
    with demand("keys"):
        _check_keys(motion, states, dt, keys)
    with demand("linearisation"):
        _check_linearisation(motion, states, dt)
    with demand("noise"):
        _check_noise(motion, states[:, :1], dt, seed)
    with demand("density"):
        _check_density(motion, states, dt, keys)
    with demand("assumed"):
        _check_assumed(motion, states, dt)


def _check_columns(motion: MotionModel) -> None:
    size = len(motion.columns)
    assert size and len(set(motion.columns)) == size, f"columns must have different names: {motion.columns}"
    assert len(motion.units) == size, f"{size} columns and {len(motion.units)} units"
    assert 1 <= len(motion.position) <= 2, "position must name one column (x) or two (x and y)"
    assert all(0 <= column < size for column in motion.position), f"position {motion.position} is not among the columns"


def _checked_truth(motion: MotionModel, dt: float, seed: int) -> Floats:
    first, again = (motion.truth(STEPS, dt, np.random.default_rng(seed)) for _ in range(2))
    wanted = (STEPS + 1, len(motion.columns))
    assert first.shape == wanted, f"truth has the shape {first.shape}, expected {wanted}: steps + 1 rows"
    assert np.isfinite(first).all(), "truth is not finite"
    assert np.array_equal(first, again), "the same generator gives two different trajectories"
    return first


def _check_shapes(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    before = states.copy()
    for name, after in (
        ("advance", motion.advance(states, dt, 0.0)),
        ("propagate", motion.propagate(states, dt, keys, 0.0)),
    ):
        assert after.shape == states.shape, f"{name} turns states {states.shape} into {after.shape}"
        assert np.isfinite(after).all(), f"{name} gives states that are not finite"
        assert np.array_equal(states, before), f"{name} changes the states that it is given"


def _check_keys(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    whole = motion.propagate(states, dt, keys, 0.0)
    order = np.arange(states.shape[1])[::-1]
    turned = motion.propagate(np.ascontiguousarray(states[:, order]), dt, keys[order], 0.0)
    assert np.allclose(whole[:, order], turned, rtol=ROUNDING, atol=ROUNDING), (
        "the noise of a particle depends on other particles or on the order of calls, not on its key alone"
    )
    _, noise = motion.matrices(states, dt, 0.0)
    if np.trace(noise) > 0.0:
        other = motion.propagate(states, dt, derive_all(7, keys), 0.0)
        assert not np.array_equal(whole, other), "other keys give the same noise"


def _check_linearisation(motion: MotionModel, states: Floats, dt: float) -> None:
    size, count = states.shape
    transitions, noise = motion.matrices(states, dt, 0.0)
    assert transitions.shape == (count, size, size), f"F has the shape {transitions.shape}, expected (N, D, D)"
    assert noise.shape == (size, size), f"Q has the shape {noise.shape}, expected (D, D)"
    assert np.allclose(noise, noise.T, rtol=ROUNDING, atol=0.0), "Q is not symmetric"
    assert np.linalg.eigvalsh(noise)[0] >= -ROUNDING * max(np.trace(noise), 1e-300), "Q is not positive semidefinite"
    for column in range(size):
        width = 1e-5 * max(1.0, float(np.abs(states[column]).max()))
        shift = np.zeros((size, 1))
        shift[column] = width
        slopes = (motion.advance(states + shift, dt, 0.0) - motion.advance(states - shift, dt, 0.0)) / (2.0 * width)
        error = np.abs(slopes - transitions[:, :, column].T).max()
        assert error <= 1e-3 * max(1.0, np.abs(slopes).max()), (
            f"F is not the derivative of advance by {motion.columns[column]}: they differ by {error:g}"
        )


def _check_noise(motion: MotionModel, state: Floats, dt: float, seed: int) -> None:
    _, noise = motion.matrices(state, dt, 0.0)
    keys = derive_all(seed + 1, np.arange(SAMPLES))
    samples = motion.propagate(np.ascontiguousarray(np.repeat(state, SAMPLES, axis=1)), dt, keys, 0.0)
    expected = motion.advance(state, dt, 0.0)[:, 0]
    deviations = np.sqrt(np.diag(noise))
    error = np.abs(samples.mean(axis=1) - expected)
    allowed = SIGMAS * deviations / np.sqrt(SAMPLES) + ROUNDING * np.maximum(1.0, np.abs(expected))
    assert (error <= allowed).all(), f"the mean of propagate differs from advance by {error}, allowed {allowed}"
    spread = samples.std(axis=1)
    assert (np.abs(spread - deviations) <= SIGMAS * deviations / np.sqrt(2.0 * SAMPLES) + ROUNDING).all(), (
        f"the standard deviations of propagate are {spread}, and by Q they are {deviations}"
    )


def _check_density(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    likely = motion.propagate(states, dt, keys, 0.0)
    _, noise = motion.matrices(states, dt, 0.0)
    far = likely + 20.0 * np.sqrt(np.diag(noise))[:, None]
    try:
        near_logs, far_logs = (motion.log_transition(after, states, dt, 0.0) for after in (likely, far))
    except RunError:
        return  # a singular covariance: the message says so to the user
    assert near_logs.shape == (states.shape[1],), f"log_transition has the shape {near_logs.shape}, expected (N,)"
    assert not np.isnan(near_logs).any() and not np.isnan(far_logs).any(), "log_transition gives NaN"
    assert (near_logs > far_logs).all(), "an unlikely successor has a greater density than a likely one"


def _check_assumed(motion: MotionModel, states: Floats, dt: float) -> None:
    _, noise = motion.matrices(states, dt, 0.0)
    _, scaled = motion.assumed(4.0).matrices(states, dt, 0.0)
    assert np.allclose(scaled, 4.0 * noise, rtol=1e-6, atol=0.0), "assumed(4) does not have four times the covariance"
