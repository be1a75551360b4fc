"""Small Gaussians by hand, against NumPy, SciPy and the joint Gaussian of state and readings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wsnsim.base.rng import derive_all
from wsnsim.kernels.gaussian import cholesky, fit, fit_weighted, log_density, predict, sample, update

KEYS = derive_all(17, np.arange(20_000))


def spd(rng: np.random.Generator, count: int, size: int = 4) -> np.ndarray:
    root = rng.normal(size=(count, size, size))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(size)


def test_the_factor_of_a_definite_matrix_is_numpys() -> None:
    for matrix in spd(np.random.default_rng(1), 20):
        factor = np.zeros((4, 4))
        cholesky(matrix, factor)
        assert factor == pytest.approx(np.linalg.cholesky(matrix), rel=1e-12)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_a_singular_matrix_is_factorised_with_a_jitter_that_cannot_be_seen(size: int) -> None:
    direction = np.arange(1.0, size + 1)
    matrix = np.outer(direction, direction) if size > 1 else np.zeros((1, 1))
    factor = np.zeros((size, size))
    cholesky(matrix, factor)
    assert factor @ factor.T == pytest.approx(matrix, abs=1e-6)


@pytest.mark.parametrize("broken", [np.full((2, 2), np.nan), np.full((2, 2), np.inf), -np.eye(2)])
def test_what_is_no_covariance_still_gives_a_factor(broken: np.ndarray) -> None:
    factor = np.zeros((2, 2))
    cholesky(broken, factor)
    assert factor == pytest.approx(np.eye(2))


def test_a_fit_is_the_sample_mean_and_covariance_with_a_ridge() -> None:
    cloud = np.random.default_rng(2).normal(2.0, 3.0, (4, 30))
    offsets = np.array([0, 1, 1, 20, 30])
    means, factors = fit(cloud, offsets, 1e-3)
    assert means[0] == pytest.approx(cloud[:, 0]) and factors[0] == pytest.approx(np.sqrt(1e-3) * np.eye(4))
    for m, (first, last) in ((2, (1, 20)), (3, (20, 30))):
        assert means[m] == pytest.approx(cloud[:, first:last].mean(axis=1), rel=1e-9)
        assert factors[m] @ factors[m].T == pytest.approx(np.cov(cloud[:, first:last]) + 1e-3 * np.eye(4), rel=1e-9)


def test_a_weighted_fit_is_numpys_weighted_covariance_with_a_ridge() -> None:
    rng = np.random.default_rng(2)
    cloud, weights = rng.normal(2.0, 3.0, (4, 30)), rng.uniform(0.0, 1.0, 30)
    weights[[3, 25]] = 0.0
    offsets = np.array([0, 1, 1, 20, 30])
    means, factors = fit_weighted(cloud, np.log(weights, where=weights > 0, out=np.full(30, -np.inf)), offsets, 1e-3)
    assert means[0] == pytest.approx(cloud[:, 0]) and factors[0] == pytest.approx(np.sqrt(1e-3) * np.eye(4))
    for m, (first, last) in ((2, (1, 20)), (3, (20, 30))):
        piece, share = cloud[:, first:last], weights[first:last]
        assert means[m] == pytest.approx(np.average(piece, axis=1, weights=share), rel=1e-9)
        expected = np.cov(piece, aweights=share) + 1e-3 * np.eye(4)
        assert factors[m] @ factors[m].T == pytest.approx(expected, rel=1e-9)


def test_a_weighted_fit_with_equal_weights_is_the_fit_without() -> None:
    cloud, offsets = np.random.default_rng(2).normal(2.0, 3.0, (4, 30)), np.array([0, 12, 30])
    for found, expected in zip(
        fit_weighted(cloud, np.full(30, -3.0), offsets, 1e-3), fit(cloud, offsets, 1e-3), strict=True
    ):
        assert found == pytest.approx(expected, rel=1e-12)


def test_log_densities_differ_from_scipys_by_a_constant_of_their_segment() -> None:
    rng = np.random.default_rng(3)
    points, means, covs = rng.normal(size=(4, 25)), rng.normal(size=(2, 4)), spd(rng, 2)
    found = log_density(points, means, np.linalg.cholesky(covs), np.array([0, 10, 25]))
    for m, (first, last) in enumerate(((0, 10), (10, 25))):
        law = multivariate_normal(means[m], covs[m])
        constant = law.logpdf(means[m])
        assert found[first:last] == pytest.approx(law.logpdf(points[:, first:last].T) - constant, rel=1e-9)


def test_samples_come_with_their_own_density() -> None:
    rng = np.random.default_rng(4)
    means, covs = rng.normal(size=(4, 12)), spd(rng, 12)
    points, logs = sample(means, covs, KEYS[:12])
    for j in range(12):
        expected = multivariate_normal(means[:, j], covs[j]).logpdf(points[:, j]) + 2.0 * np.log(2.0 * np.pi)
        assert logs[j] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("size", [3, 4])
def test_samples_have_the_moments_that_were_asked_for(size: int) -> None:
    rng = np.random.default_rng(5)
    mean, cov = rng.normal(size=size), spd(rng, 1, size)[0]
    points, _ = sample(mean[:, None].copy(), cov[None], KEYS)
    scale = np.sqrt(np.diag(cov))
    assert (points.mean(axis=1) - mean) / scale == pytest.approx(np.zeros(size), abs=4.0 / np.sqrt(KEYS.size))
    assert np.cov(points) / np.outer(scale, scale) == pytest.approx(
        cov / np.outer(scale, scale), abs=6.0 / np.sqrt(KEYS.size)
    )


def test_one_gaussian_serves_every_key_as_many_equal_ones_would() -> None:
    rng = np.random.default_rng(6)
    mean, cov = rng.normal(size=(4, 1)), spd(rng, 1)
    one = sample(mean, cov, KEYS[:30])
    many = sample(np.repeat(mean, 30, axis=1), np.repeat(cov, 30, axis=0), KEYS[:30])
    assert np.array_equal(one[0], many[0]) and np.array_equal(one[1], many[1])


def test_a_prediction_is_f_p_ft_plus_q() -> None:
    rng = np.random.default_rng(7)
    covs, transitions, noise = spd(rng, 9), rng.normal(size=(9, 4, 4)), spd(rng, 1)[0]
    found = predict(covs, transitions, noise)
    assert found == pytest.approx(transitions @ covs @ transitions.transpose(0, 2, 1) + noise, rel=1e-9)
    assert np.array_equal(found, found.transpose(0, 2, 1))


def test_an_update_conditions_the_joint_gaussian_of_state_and_readings() -> None:
    rng = np.random.default_rng(8)
    means, covs = rng.normal(size=(4, 6)), spd(rng, 6)
    gradients, variances = rng.normal(size=(5, 2, 6)), rng.uniform(0.1, 2.0, (5, 6))
    expected, readings = rng.normal(size=(5, 6)), rng.normal(size=5)
    new_means, new_covs = means.copy(), covs.copy()
    update(new_means, new_covs, expected, gradients, variances, readings, np.array([0, 2]))
    for j in range(6):
        slope = np.zeros((5, 4))
        slope[:, [0, 2]] = gradients[:, :, j]
        cross = covs[j] @ slope.T
        gain = cross @ np.linalg.inv(slope @ cross + np.diag(variances[:, j]))
        assert new_means[:, j] == pytest.approx(means[:, j] + gain @ (readings - expected[:, j]), rel=1e-8)
        assert new_covs[j] == pytest.approx(covs[j] - gain @ cross.T, rel=1e-8, abs=1e-10)


def test_an_update_passes_over_a_reading_that_has_no_variance_to_speak_of() -> None:
    means, covs = np.zeros((2, 1)), np.eye(2)[None].copy()
    gradients = np.array([[[np.inf], [0.0]], [[1.0], [0.0]]])
    update(means, covs, np.zeros((2, 1)), gradients, np.ones((2, 1)), np.array([5.0, 1.0]), np.array([0, 1]))
    assert means[:, 0] == pytest.approx([0.5, 0.0]) and covs[0] == pytest.approx(np.diag([0.5, 1.0]))
