"""The vectorisable logarithm, exponential and normal pairs, against the C library and the NumPy twin of the noise."""

import numpy as np
import pytest
from numba import njit

from wsnsim.base import rng
from wsnsim.kernels.compilation import OPTIONS
from wsnsim.kernels.elementary import exp, exp2, log, log2, normal_pair

SAME_OPTIONS = {**OPTIONS, "cache": False}


@njit(**SAME_OPTIONS)
def logs(x):
    result = np.empty_like(x)
    for i in range(x.size):
        result[i] = log(x[i])
    return result


@njit(**SAME_OPTIONS)
def exponentials(x):
    result = np.empty_like(x)
    for i in range(x.size):
        result[i] = exp(x[i])
    return result


@njit(**SAME_OPTIONS)
def powers(x, exponent):
    result = np.empty_like(x)
    for i in range(x.size):
        result[i] = exp(exponent * log(x[i]))
    return result


@njit(**SAME_OPTIONS)
def logs_and_powers_to_base_two(x, exponent):
    result = np.empty((2, x.size))
    for i in range(x.size):
        result[0, i] = log2(x[i])
        result[1, i] = exp2(exponent * log2(x[i]))
    return result


@njit(**SAME_OPTIONS)
def pairs(keys, pair):
    result = np.empty((2, keys.size))
    for i in range(keys.size):
        result[0, i], result[1, i] = normal_pair(keys[i], pair)
    return result


def test_the_logarithm_agrees_with_the_library_over_all_normal_numbers():
    """Near 1 the error is absolute: Numba 0.61 adds the parts, of order 1, in an order that leaves 5e-14."""
    x = np.concatenate([10.0 ** np.linspace(-307, 308, 20001), np.linspace(0.5, 2.0, 20001), [1.0]])
    assert np.allclose(logs(x), np.log(x), rtol=1e-13, atol=1e-13)
    assert logs(np.array([1.0]))[0] == 0.0


def test_the_exponential_agrees_with_the_library_and_stays_normal_below():
    y = np.linspace(-700.0, 700.0, 40001)
    allowed = 3e-14 + 2.0 * np.finfo(float).eps * np.abs(y)  # the error of the series, and that of rounding y
    assert (np.abs(exponentials(y) / np.exp(y) - 1.0) <= allowed).all()
    assert np.array_equal(exponentials(np.array([-800.0, -np.inf])), exponentials(np.array([-700.0, -700.0])))


def test_a_power_made_of_both_keeps_its_digits_when_the_compiler_reorders():
    """Fast-math once distributed a factor over a large constant in the logarithm, and lost a tenth of the result."""
    d = np.linspace(1.0, 1e5, 5001)
    assert np.allclose(powers(d, -1.1), d**-1.1, rtol=1e-12, atol=0.0)


def test_powers_to_the_base_two_agree_with_the_library():
    x = np.concatenate([10.0 ** np.linspace(-250, 250, 20001), np.linspace(0.5, 2.0, 2001)])
    for exponent in (-1.1, 1.0, 0.3):
        found, powers = logs_and_powers_to_base_two(x, exponent)
        assert np.allclose(found, np.log2(x), rtol=1e-15, atol=1e-15)
        assert np.allclose(powers, x**exponent, rtol=1e-12, atol=0.0)
    d = np.linspace(1.0, 1e5, 5001)
    assert np.allclose(logs_and_powers_to_base_two(d, -1.1)[1], d**-1.1, rtol=2e-14, atol=0.0)
    last = logs_and_powers_to_base_two(np.array([1e300, np.inf]), -9.0)[1]
    assert np.allclose(last, 2.0**-1000, rtol=1e-12)


@pytest.mark.parametrize("pair", [0, 1, 5])
def test_a_pair_is_the_cosine_and_the_sine_of_the_same_draw(pair):
    keys = rng.derive_all(11, np.arange(5000))
    radius = np.sqrt(-2.0 * np.log1p(-rng.uniforms(keys, 2 * pair)))
    angle = 2.0 * np.pi * rng.uniforms(keys, 2 * pair + 1)
    assert np.allclose(pairs(keys, pair), [radius * np.cos(angle), radius * np.sin(angle)], atol=1e-12)
    assert np.allclose(pairs(keys, pair)[0], rng.normals(keys, pair), atol=1e-12)


def test_pairs_are_standard_and_uncorrelated():
    draws = pairs(rng.derive_all(12, np.arange(200_000)), 0)
    assert np.allclose(draws.mean(axis=1), 0.0, atol=0.01)
    assert np.allclose(np.cov(draws), np.eye(2), atol=0.015)
