"""Updates with detections of uncertain origin, against the mixture that they stand for, written in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wsnsim.kernels.detections import condition, score


def innovations(means, covs, first, detections, periods):
    """(N, M, d) the shortest innovations and (N, d, d) their covariances."""
    read = slice(first, first + periods.size)
    apart = detections - means[:, None, read]
    turn = np.where(periods > 0.0, periods, np.inf)
    return apart - np.where(periods > 0.0, periods, 0.0) * np.round(apart / turn), covs[:, read, read]


def score_twin(means, covs, first, detections, periods):
    apart, widths = innovations(means, covs, first, detections, periods)
    squares = np.einsum("nmp,npq,nmq->nm", apart, np.linalg.inv(widths), apart)
    logs = -0.5 * (squares + np.linalg.slogdet(2.0 * np.pi * widths)[1][:, None])
    return logs, squares


def condition_twin(means, covs, first, detections, periods, probabilities):
    apart, widths = innovations(means, covs, first, detections, periods)
    gains = covs[:, :, first : first + periods.size] @ np.linalg.inv(widths)
    shifts, totals = np.einsum("nm,nmp->np", probabilities, apart), probabilities.sum(axis=1)
    spreads = np.einsum("nm,nmp,nmq->npq", probabilities, apart, apart) - shifts[:, :, None] * shifts[:, None]
    means += np.einsum("nap,np->na", gains, shifts)
    covs += gains @ (spreads - totals[:, None, None] * widths) @ gains.transpose(0, 2, 1)


def joint(rng, count, columns):
    roots = rng.normal(size=(count, columns, columns + 2))
    return rng.normal(size=(count, columns)), np.ascontiguousarray(roots @ roots.transpose(0, 2, 1))


@pytest.mark.parametrize("size", [1, 2, 3])
def test_densities_and_distances_are_those_of_the_innovation(size) -> None:
    rng = np.random.default_rng(size)
    means, covs = joint(rng, 4, 5 + size)
    detections = rng.normal(size=(6, size))
    logs, squares = score(means, covs, 4, detections, np.zeros(size))
    for n in range(4):
        width, expected = covs[n, 4 : 4 + size, 4 : 4 + size], means[n, 4 : 4 + size]
        truth = multivariate_normal(expected, width).logpdf(detections)
        assert logs[n] == pytest.approx(np.atleast_1d(truth), rel=1e-9)
        off = detections - expected
        assert squares[n] == pytest.approx((off * np.linalg.solve(width, off.T).T).sum(axis=1), rel=1e-9)


@pytest.mark.parametrize("size", [1, 2])
def test_moments_after_a_scan_are_those_of_the_mixture_over_the_origins(size) -> None:
    rng = np.random.default_rng(10 + size)
    means, covs = joint(rng, 3, 5 + size)
    detections, periods = rng.normal(size=(4, size)), np.zeros(size)
    shares = rng.dirichlet(np.ones(5), 3)
    after, spreads = means.copy(), covs.copy()
    condition(after, spreads, 2, detections, periods, np.ascontiguousarray(shares[:, 1:]))
    read = slice(2, 2 + size)
    for n in range(3):
        gain = covs[n, :, read] @ np.linalg.inv(covs[n, read, read])
        one = covs[n] - gain @ covs[n, read]
        centres = [means[n], *(means[n] + gain @ (value - means[n, read]) for value in detections)]
        mean = shares[n] @ np.array(centres)
        cov = sum(
            share * ((covs[n] if place == 0 else one) + np.outer(centre - mean, centre - mean))
            for place, (share, centre) in enumerate(zip(shares[n], centres, strict=True))
        )
        assert after[n] == pytest.approx(mean, abs=1e-9)
        assert spreads[n] == pytest.approx(cov, abs=1e-9)
        assert np.array_equal(spreads[n], spreads[n].T)


def test_angles_are_compared_at_their_shortest_difference() -> None:
    means, covs = np.array([[0.0, 3.1]]), np.array([[[1.0, 0.4], [0.4, 0.5]]])
    turned = means.copy(), covs.copy()
    period = np.array([2.0 * np.pi])
    logs, _ = score(means, covs, 1, np.array([[-3.1], [3.1 + 0.0831853]]), period)
    assert logs[0, 0] == pytest.approx(logs[0, 1], abs=1e-6)
    condition(*turned, 1, np.array([[-3.1]]), period, np.ones((1, 1)))
    assert turned[0][0] == pytest.approx([0.8 * (2 * np.pi - 6.2), 2 * np.pi - 3.1])


def test_without_a_share_nothing_changes() -> None:
    means, covs = joint(np.random.default_rng(4), 2, 5)
    kept = means.copy(), covs.copy()
    condition(means, covs, 4, np.zeros((1, 1)), np.zeros(1), np.zeros((2, 1)))
    condition(means, covs, 4, np.zeros((0, 1)), np.zeros(1), np.zeros((2, 0)))
    assert np.array_equal(means, kept[0]) and np.array_equal(covs, kept[1])
