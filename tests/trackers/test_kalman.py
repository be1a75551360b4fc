"""Updates of many Kalman filters at once."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.scenes import make_scene
from tests.trackers.test_mixture_pf import H, textbook_update
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range
from wsnsim.trackers import mixture_pf
from wsnsim.trackers.mixture_pf import PLACE, updated_by_fix, updated_by_readings
from wsnsim.trackers.shared.readings import Evidence

always = pytest.mark.parametrize("share", [mixture_pf.SHARP, np.inf], ids=["where needed", "always"])


def bank(scale, count=5):
    """Means (K, 4) and covariances (K, 4, 4) of filters whose errors are some `scale` m."""
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(count, 4, 4)) * scale
    return rng.normal(size=(count, 4)) * scale, roots @ roots.transpose(0, 2, 1)


def rotated(variances):
    """A covariance with these variances along axes that are not those of the coordinates."""
    axes = np.array([[0.6, -0.8], [0.8, 0.6]])
    return axes @ np.diag(variances) @ axes.T


@always
def test_a_fix_updates_each_filter_as_the_textbook_says(share, monkeypatch) -> None:
    monkeypatch.setattr(mixture_pf, "SHARP", share)
    means, covs = bank(3.0)
    point, noise = np.array([1.0, -2.0]), rotated([0.5, 4.0])
    found = updated_by_fix(means, covs, point, noise)
    for mean, cov, *mine in zip(means, covs, *found, strict=True):
        after, shrunk, score = textbook_update(mean, cov, point, H, noise)
        assert mine[0] == pytest.approx(after, rel=1e-8) and mine[1] == pytest.approx(shrunk, rel=1e-7, abs=1e-9)
        assert mine[2] == pytest.approx(score + np.log(2.0 * np.pi), rel=1e-9), "but for the constant"


@always
def test_readings_update_each_filter_as_the_textbook_says(share, monkeypatch) -> None:
    monkeypatch.setattr(mixture_pf, "SHARP", share)
    means, covs = bank(1.0)
    place, sensor = np.array([[30.0, -40.0]]), Range(sd=2.0)
    seen = Evidence((0,), np.array([51.0]), place, np.ones((1, 1)))
    found = updated_by_readings(means, covs, seen, make_scene(1, (0,), place, seen.traits, BoundedVelocity(), sensor))
    for mean, cov, *mine in zip(means, covs, *found, strict=True):
        away = mean[PLACE] - place[0]
        slope = np.array([[away[0], 0.0, away[1], 0.0]]) / np.hypot(*away)
        z = 51.0 - np.hypot(*away) + slope @ mean
        after, shrunk, score = textbook_update(mean, cov, z, slope, np.array([[4.0]]))
        assert mine[0] == pytest.approx(after, rel=1e-8) and mine[1] == pytest.approx(shrunk, rel=1e-7, abs=1e-9)
        assert mine[2] == pytest.approx(score + 0.5 * np.log(2.0 * np.pi), rel=1e-9)


def are_covariances(covs) -> bool:
    """Whether no variance along any axis is negative, but for the rounding of the largest."""
    values = np.linalg.eigvalsh(covs)
    own = np.linalg.eigvalsh(covs[:, PLACE][:, :, PLACE])
    return bool((values[:, 0] > -1e-14 * values[:, -1]).all() and (own[:, 0] > 0.0).all())


def test_a_fix_that_leaves_one_axis_open_says_nothing_along_it_and_all_across_it() -> None:
    means, covs = bank(3.0)
    later, after, scores = updated_by_fix(means, covs, np.array([1.0, -2.0]), rotated([1e-12, 1e12]))
    along, across = np.array([-0.8, 0.6]), np.array([0.6, 0.8])
    assert are_covariances(after) and np.isfinite(scores).all()
    assert np.einsum("i,kij,j->k", across, after[:, PLACE][:, :, PLACE], across).max() < 1e-3
    cross = covs[:, :, PLACE] @ across
    left = covs - cross[:, :, None] * cross[:, None, :] / (cross[:, PLACE] @ across)[:, None, None]
    told = np.einsum("i,kij,j->k", along, left[:, PLACE][:, :, PLACE], along)
    assert np.einsum("i,kij,j->k", along, after[:, PLACE][:, :, PLACE], along) == pytest.approx(told, rel=1e-3)
    assert later[:, PLACE] @ across == pytest.approx(np.full(5, 0.6 - 1.6), abs=1e-2)


def test_a_fix_far_sharper_than_the_prediction_leaves_its_own_covariance() -> None:
    means, covs = bank(1e4)
    noise = rotated([1e-10, 3e-10])
    _, after, scores = updated_by_fix(means, covs, np.zeros(2), noise)
    assert are_covariances(after) and np.isfinite(scores).all()
    assert after[:, PLACE][:, :, PLACE] == pytest.approx(np.repeat(noise[None], 5, axis=0), rel=1e-4)


def test_readings_far_sharper_than_the_prediction_leave_their_variance_along_each_direction() -> None:
    means, covs = bank(1e2)
    place, sensor = np.array([[3000.0, 0.0], [0.0, -4000.0]]), Range(sd=1e-7, reach=1e5)
    seen = Evidence((0, 1), np.array([3001.0, 4002.0]), place, np.ones((2, 1)))
    scene = make_scene(1, (0, 1), place, seen.traits, BoundedVelocity(), sensor)
    _, after, scores = updated_by_readings(means, covs, seen, scene)
    assert are_covariances(after) and np.isfinite(scores).all()
    assert after[:, PLACE, PLACE].max() < 1e-13
