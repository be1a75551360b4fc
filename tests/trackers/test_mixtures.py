"""Mixtures: cut where the law of motion changes, weighed by the readings, merged when they agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.scenes import make_scene
from tests.trackers.test_posteriors import PLACE, on_a_grid
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.mobility import CoordinatedTurn
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.trackers.shared.mixtures import Hypothesis, moments_of, predicted_mixture, reduced, updated_mixture
from wsnsim.trackers.shared.readings import Evidence

COV = np.array([[0.04, 0.03, 0.0, 0.0], [0.03, 0.5, 0.0, 0.0], [0.0, 0.0, 0.04, 0.0], [0.0, 0.0, 0.0, 0.5]])


def scene_with(motion, **changes):
    nothing = np.empty((0, 2)), np.empty((0, 1))
    return make_scene(1, (), *nothing, motion, AcousticEnergy(), dt=0.04, **changes)


def at(px, py=0.0):
    return (Hypothesis(0.0, np.array([px, 5.0, py, -3.0]), COV),)


def test_a_gaussian_that_straddles_a_wall_is_cut_into_what_particles_make_of_it() -> None:
    motion = BoundedVelocity(noise="q_only", q=1e-12)
    after = predicted_mixture(at(180.1), scene_with(motion), 0.0, 1)
    assert len(after) == 2
    rng = np.random.default_rng(1)
    states = at(180.1)[0].mean[:, None] + np.linalg.cholesky(COV) @ rng.normal(size=(4, 400_000))
    beyond = np.abs(states[0]) > 180.0
    moved = motion.advance(np.ascontiguousarray(states), 0.04)
    for one, cloud in zip(after, (moved[:, beyond], moved[:, ~beyond]), strict=True):
        assert np.exp(one.log_weight) == pytest.approx(cloud.shape[1] / 400_000, abs=0.01)
        assert one.mean == pytest.approx(cloud.mean(axis=1), abs=0.01)
        assert one.cov == pytest.approx(np.cov(cloud), abs=0.01)
    mean, cov = moments_of(after)
    assert mean == pytest.approx(moved.mean(axis=1), abs=0.03) and cov == pytest.approx(np.cov(moved), abs=0.1)


def test_a_gaussian_in_a_corner_is_cut_along_both_axes() -> None:
    assert len(predicted_mixture(at(180.0, -180.05), scene_with(BoundedVelocity()), 0.0, 1)) == 4


@pytest.mark.parametrize("motion", [BoundedVelocity(), ConstantVelocity()], ids=["far from the wall", "no wall"])
def test_one_law_keeps_one_gaussian(motion) -> None:
    (after,) = predicted_mixture(at(100.0), scene_with(motion), 0.0, 1)
    laws, noise = motion.matrices(at(100.0)[0].mean[:, None], 0.04, 0.0)
    assert after.mean == pytest.approx(laws[0] @ at(100.0)[0].mean)
    assert after.cov == pytest.approx(laws[0] @ COV @ laws[0].T + noise)


def test_a_law_that_changes_smoothly_is_not_cut() -> None:
    mean, cov = np.array([0.0, 5.0, 0.0, 1.0, 0.3]), np.eye(5)
    assert len(predicted_mixture((Hypothesis(0.0, mean, cov),), scene_with(CoordinatedTurn()), 0.0, 3)) == 1


class Jump(ConstantVelocity):
    """A constant velocity that also carries everybody beyond x = 50 m a metre on: its matrices say nothing of it."""

    def advance(self, states, dt, time=0.0):
        moved = super().advance(states, dt, time)
        moved[0] += np.where(states[0] > 50.0, 1.0, 0.0)
        return moved


def test_a_jump_that_only_advance_knows_of_is_cut_too() -> None:
    first, second = predicted_mixture(at(50.0), scene_with(Jump()), 0.0, 1)
    assert abs(first.mean[0] - second.mean[0]) > 1.0


def test_readings_weigh_two_hypotheses_by_their_evidence() -> None:
    sensor, rng = AcousticEnergy(), np.random.default_rng(4)
    positions = rng.uniform(140.0, 200.0, (7, 2)) * [1.0, 0.1]
    traits = np.ones((7, 1))
    two = predicted_mixture(at(180.1), scene_with(BoundedVelocity()), 0.0, 1)
    assert len(two) == 2
    true = np.tile(two[1].mean[PLACE], (7, 1))
    seen = Evidence(tuple(range(7)), sensor.measure(true, positions, traits, rng.normal(size=7)), positions, traits)
    scene = make_scene(5, seen.ids, positions, traits, BoundedVelocity(), sensor, dt=0.04)
    after = updated_mixture(two, seen, scene)
    grids = [on_a_grid(one.mean, one.cov, seen, sensor, true[0], 2.5)[2] + one.log_weight for one in two]
    weights = np.exp([one.log_weight for one in after])
    assert weights.sum() == pytest.approx(1.0) and len(after) == 2
    found = sorted(np.log(weights))
    assert found[1] - found[0] == pytest.approx(abs(grids[0] - grids[1]), abs=5e-3)


def test_hypotheses_that_agree_become_one_with_the_moments_of_both() -> None:
    (one,) = at(3.0)
    near = replace_mean(one, one.mean + np.array([0.05, 0.0, 0.0, 0.0]), 0.5)
    (merged,) = reduced([one, near])
    mean, cov = moments_of(tuple(each._replace(log_weight=np.log(0.5)) for each in (one, near)))
    weights = np.array([1.0, np.exp(0.5)]) / (1.0 + np.exp(0.5))
    assert merged.mean == pytest.approx(weights @ [one.mean, near.mean])
    assert merged.log_weight == pytest.approx(0.0) and merged.cov == pytest.approx(cov, abs=1e-3)
    assert mean == pytest.approx((one.mean + near.mean) / 2)


def replace_mean(one, mean, log_weight):
    return one._replace(mean=mean, log_weight=log_weight)


def test_the_unlikely_are_dropped_and_the_rest_has_weights_that_sum_to_one() -> None:
    apart = [replace_mean(at(0.0)[0], np.array([10.0 * k, 0, 0, 0]), -3.0 * k) for k in range(12)]
    kept = reduced(apart)
    assert len(kept) == 4
    assert np.exp([each.log_weight for each in kept]).sum() == pytest.approx(1.0)
    assert [each.mean[0] for each in kept] == [0.0, 10.0, 20.0, 30.0]


def test_readings_that_nothing_explains_change_nothing() -> None:
    seen = Evidence((0,), np.array([np.nan]), np.zeros((1, 2)), np.ones((1, 1)))
    scene = replace(scene_with(BoundedVelocity()), ids=(0,))
    (after,) = updated_mixture(at(3.0), seen, scene)
    assert after.mean == pytest.approx(at(3.0)[0].mean) and after.cov == pytest.approx(COV)
