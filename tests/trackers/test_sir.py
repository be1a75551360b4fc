"""The textbook particle filter: against the Kalman filter, and that it resamples when it says."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearSensor, against_kalman, sent
from wsnsim.testing import check_tracker
from wsnsim.trackers.bootstrap_pf import Pf


class Deaf(LinearSensor):
    """Whatever is read is impossible."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return np.full(points.shape[1], -np.inf)


class Indifferent(LinearSensor):
    """Whatever is read says nothing."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return np.zeros(points.shape[1])


def stepped(tracker: Pf, sensor: LinearSensor):
    """The belief before and after a step."""
    cluster = Cluster(4, sensor=sensor)
    before, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    after, heard = cluster.drive(tracker.step(before, cluster.scene(1)))
    return before, after, heard, cluster


def test_on_a_linear_gaussian_model_it_is_the_kalman_filter_but_for_its_particles() -> None:
    errors, ratios = against_kalman(Pf(particles=1000), seeds=6)
    assert np.sqrt(np.mean(errors**2)) < 0.4, "root mean square distance of the means, in the Kalman filter's sd"
    assert np.abs(errors.mean(axis=0)).max() < 0.2, "a bias"
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)


def test_it_resamples_at_every_step_and_says_what_it_believed_before() -> None:
    _, after, heard, cluster = stepped(Pf(particles=100), LinearSensor())
    assert not after.pool.log_weights.any() and np.unique(after.pool.cloud[0]).size < 100
    assert 1.0 < after.effective < 90.0, "the estimate's weights are those before the resampling"
    assert not np.allclose(after.mean, after.pool.cloud.mean(axis=1), rtol=0.0, atol=1e-9)
    assert sent(heard, cluster.head) == {"^reading": 3} and heard.cycles == {cluster.head: 100 * (40 + 30 * 4)}


def test_it_resamples_equal_weights_too_and_a_threshold_keeps_it_from_that() -> None:
    _, after, _, _ = stepped(Pf(particles=50), Indifferent())
    assert after.effective == pytest.approx(50.0)
    _, after, _, _ = stepped(Pf(particles=50, threshold=0.01), LinearSensor())
    assert after.pool.log_weights.any(), "more than half a particle is effective"


@pytest.mark.parametrize("threshold", [1.0, 0.5, 0.0])
def test_where_nothing_is_likely_all_particles_go_on_and_none_is_effective(threshold: float) -> None:
    _, after, _, _ = stepped(Pf(particles=20, threshold=threshold), Deaf())
    assert after.effective == 0.0 and np.isfinite(after.mean).all() and not after.pool.log_weights.any()
    assert np.unique(after.pool.cloud[0]).size == 20


@pytest.mark.thorough
@pytest.mark.parametrize("particles", [1, 2, 3, 100])
def test_it_keeps_the_rules_of_the_seam(particles: int) -> None:
    check_tracker(Pf(particles=particles))
