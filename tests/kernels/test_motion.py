"""The motion kernels against plain NumPy that follows the equations line by line."""

import numpy as np

from wsnsim.base import rng
from wsnsim.kernels import acoustic

STEP, BOUND, C1, C2 = 0.04, 180.0, 0.75, 1.0
LAW = (STEP, BOUND, C1, C2)
ROOT = (0.02, 0.5, 0.3)


def twin(states, keys):
    """Eqs. 1-4: one column at a time, with 4x4 matrices, and the normals of the counter hash."""
    inner = np.array([[1, STEP], [0, 1]])
    outer = np.array([[1, STEP], [-STEP * C1, 1 - STEP * C2]])
    lower = np.array([[ROOT[0], 0], [ROOT[1], ROOT[2]]])
    result = np.empty_like(states)
    for j in range(states.shape[1]):
        for axis in range(2):
            key = keys[j : j + 1]
            radius = np.sqrt(-2.0 * np.log1p(-rng.uniforms(key, 2 * axis)))[0]
            angle = 2.0 * np.pi * rng.uniforms(key, 2 * axis + 1)[0]
            noise = lower @ np.array([radius * np.cos(angle), radius * np.sin(angle)])
            x = states[2 * axis : 2 * axis + 2, j]
            result[2 * axis : 2 * axis + 2, j] = (inner if abs(x[0]) <= BOUND else outer) @ x + noise
    return result


def some_states(count=300):
    states = np.random.default_rng(1).normal(0.0, 1.0, (4, count)) * np.array([[180.0], [30.0], [180.0], [30.0]])
    states[0, :3] = [180.0, -180.0, np.nextafter(180.0, 200.0)]
    return states


def test_propagation_equals_its_twin():
    states, keys = some_states(), rng.derive_all(3, np.arange(300))
    assert np.allclose(acoustic.propagate(states, keys, LAW, ROOT), twin(states, keys), atol=1e-9, rtol=0)


def test_advancing_is_propagation_without_noise():
    states, keys = some_states(), rng.derive_all(3, np.arange(300))
    silent = acoustic.propagate(states, keys, LAW, (0.0, 0.0, 0.0))
    assert np.allclose(acoustic.advance(states, LAW), silent, atol=1e-9, rtol=0)


def test_a_particle_moves_alike_in_any_company():
    states, keys = some_states(), rng.derive_all(3, np.arange(300))
    order = np.random.default_rng(2).permutation(300)
    together = acoustic.propagate(states, keys, LAW, ROOT)
    shuffled = acoustic.propagate(np.ascontiguousarray(states[:, order]), keys[order], LAW, ROOT)
    alone = acoustic.propagate(np.ascontiguousarray(states[:, 7:8]), keys[7:8], LAW, ROOT)
    assert np.allclose(shuffled, together[:, order], rtol=1e-14)
    assert np.allclose(alone[:, 0], together[:, 7], rtol=1e-14)


def test_states_that_are_not_finite_hurt_nobody_else():
    states, keys = some_states(), rng.derive_all(3, np.arange(300))
    clean = acoustic.propagate(states, keys, LAW, ROOT)
    states[0, 5], states[1, 6], states[3, 7] = np.nan, np.inf, -np.inf
    broken = acoustic.propagate(states, keys, LAW, ROOT)
    untouched = np.setdiff1d(np.arange(300), [5, 6, 7])
    assert np.array_equal(broken[:, untouched], clean[:, untouched])
    assert np.all(np.isneginf(acoustic.log_transition(broken, states, LAW, ROOT)[[5, 6, 7]]))
