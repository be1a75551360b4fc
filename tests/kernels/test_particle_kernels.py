"""Weights, moments, resampling and allocation of particles, and a step of the bootstrap filter in one call."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import floor

import numpy as np
import pytest

from tests.bench import twins
from tests.bench.entries import ENTRIES
from wsnsim.base.network_ports import Field
from wsnsim.base.ports import Scene
from wsnsim.base.rng import derive
from wsnsim.kernels.particles import allocate, moments, predict_and_score, systematic, weigh
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.trackers.shared import heads
from wsnsim.trackers.shared.dealing import Pool
from wsnsim.trackers.shared.readings import Evidence

OFFSETS = np.array([0, 5, 5, 17, 40])


def normalised(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def test_weights_get_mean_one_and_their_effective_number_per_segment() -> None:
    log_weights = np.random.default_rng(1).normal(0.0, 30.0, 40) - 5000.0
    given = log_weights.copy()
    effective = weigh(log_weights, OFFSETS)
    for m, (first, last) in enumerate(pairwise(OFFSETS.tolist())):
        if first == last:
            assert effective[m] == 0.0
            continue
        shares = normalised(given[first:last])
        assert np.exp(log_weights[first:last]) == pytest.approx(shares * (last - first), rel=1e-9, abs=1e-290)
        assert effective[m] == pytest.approx(1.0 / np.sum(shares**2), rel=1e-9)


@pytest.mark.parametrize("hopeless", [[-np.inf] * 3, [np.nan] * 3, [-np.inf, np.nan, -np.inf], [0.0, np.inf, 0.0]])
def test_where_nothing_can_be_weighed_weights_are_equal_and_none_is_effective(hopeless: list[float]) -> None:
    log_weights = np.array(hopeless)
    assert weigh(log_weights, np.array([0, 3])) == pytest.approx([0.0])
    assert log_weights.tolist() == [0.0, 0.0, 0.0]


def test_a_weight_that_is_not_a_number_counts_as_none() -> None:
    log_weights = np.array([0.0, np.nan, 0.0])
    assert weigh(log_weights, np.array([0, 3])) == pytest.approx([2.0])
    assert log_weights == pytest.approx([np.log(1.5), -np.inf, np.log(1.5)])


def test_moments_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    cloud, log_weights = rng.normal(3.0, 5.0, (4, 40)), rng.normal(0.0, 2.0, 40)
    means, covs = moments(cloud, log_weights, OFFSETS)
    for m, (first, last) in enumerate(pairwise(OFFSETS.tolist())):
        if first == last:
            assert not means[m].any() and not covs[m].any()
            continue
        shares = normalised(log_weights[first:last])
        assert means[m] == pytest.approx(cloud[:, first:last] @ shares, rel=1e-9)
        assert covs[m] == pytest.approx(np.cov(cloud[:, first:last], aweights=shares, ddof=0), rel=1e-9)


def test_a_particle_without_weight_may_be_anything() -> None:
    cloud = np.array([[1.0, 3.0, np.nan, np.inf]])
    means, covs = moments(cloud, np.array([0.0, 0.0, -np.inf, -np.inf]), np.array([0, 4]))
    assert (means[0, 0], covs[0, 0, 0]) == pytest.approx((2.0, 1.0))


def test_systematic_resampling_draws_each_particle_floor_or_ceiling_of_its_expected_number() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        log_weights = rng.normal(0.0, 2.0, 60)
        expected = 100 * normalised(log_weights)
        chosen = systematic(log_weights, np.array([0, 60]), np.array([100]), rng.random(1))
        counts = np.bincount(chosen, minlength=60)
        assert counts.sum() == 100
        assert np.all(counts >= np.floor(expected - 1e-9)) and np.all(counts <= np.ceil(expected + 1e-9))


def test_systematic_resampling_is_unbiased() -> None:
    log_weights = np.random.default_rng(4).normal(0.0, 1.5, 30)
    starts = (np.arange(4000) + 0.5) / 4000
    counts = np.zeros(30)
    for start in starts:
        drawn = systematic(log_weights, np.array([0, 30]), np.array([25]), np.array([start]))
        counts += np.bincount(drawn, minlength=30)
    assert counts / 4000 == pytest.approx(25 * normalised(log_weights), abs=2.0 / 4000)


def test_resampling_never_draws_what_has_no_weight() -> None:
    log_weights = np.array([-np.inf, 0.0, -np.inf, 1.0, -np.inf])
    for start in (0.0, 0.3, 1.0 - 2.0**-53):
        chosen = systematic(log_weights, np.array([0, 5]), np.array([7]), np.array([start]))
        assert set(chosen.tolist()) == {1, 3}


def test_segments_are_resampled_apart() -> None:
    log_weights = np.random.default_rng(5).normal(size=40)
    sizes, starts = np.array([5, 0, 30, 11]), np.array([0.1, 0.2, 0.3, 0.4])
    together = systematic(log_weights, OFFSETS, sizes, starts)
    alone = [
        first
        + systematic(log_weights[first:last].copy(), np.array([0, last - first]), sizes[m : m + 1], starts[m : m + 1])
        for m, (first, last) in enumerate(pairwise(OFFSETS.tolist()))
        if last > first
    ]
    assert together.tolist() == np.concatenate(alone).tolist()


@pytest.mark.thorough
def test_shares_sum_to_the_total_and_differ_by_one_at_most_for_every_number_of_particles_and_members() -> None:
    for active in range(1, 61):
        shares = np.array([allocate(total, active) for total in range(2001)])
        assert np.array_equal(shares.sum(axis=1), np.arange(2001))
        assert np.all(shares.max(axis=1) - shares.min(axis=1) <= 1)
        assert np.all(np.diff(shares, axis=1) >= 0)


def test_shares_follow_the_printed_recursion() -> None:
    for total, active in ((400, 17), (7, 3), (2, 5), (0, 4), (1600, 59)):
        dealt, expected = 0, []
        for i in range(1, active + 1):
            expected.append(floor(Fraction(total - dealt, active - (i - 1))))
            dealt += expected[-1]
        assert allocate(total, active).tolist() == expected


def test_nobody_gets_nothing() -> None:
    assert allocate(400, 0).size == 0


ARGUMENTS = {entry.kernel: entry.arguments for entry in ENTRIES}


def predict_and_score_twin(cloud, key, tag, steps, drift, root, readings, positions, gains, law):
    everyone = np.array([0, cloud.shape[1]])
    for passed in range(steps):
        keys = twins.particle_keys(np.array([key], np.uint64), everyone, tag + passed)
        cloud = twins.propagate(cloud, keys, drift, root)
    return cloud, twins.joint_log_likelihood(cloud[0], cloud[2], readings, positions, gains, law)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_prediction_and_its_scores_are_those_of_numpy(steps):
    cloud, key, tag, _, *constants = ARGUMENTS["particles.predict_and_score"](60)
    arguments = (cloud, key, tag, steps, *constants)
    for found, expected in zip(predict_and_score(*arguments), predict_and_score_twin(*arguments), strict=True):
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


class Drifting(BoundedVelocity):
    """A motion model of somebody else, who inherits and has a way of its own to move."""

    def propagate(self, states, dt, keys, time=0.0):
        return super().propagate(states, dt, keys, time)


class Turned(BoundedVelocity):
    """A motion model of somebody else, whose position is in other rows."""

    position = (2, 0)


class Loud(AcousticEnergy):
    """A sensor of somebody else, who inherits and has a likelihood of its own."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return super().log_likelihood(points, readings, positions, traits, owners)


def filtered(motion, sensor, threshold):
    """A belief of the bootstrap filter with these models."""
    rng = np.random.default_rng(3)
    positions, traits = rng.uniform(-40.0, 40.0, (5, 2)), rng.uniform(0.7, 1.3, (5, 1))
    ids = tuple(range(5))
    scene = Scene(
        time=0.4, step=10, steps=2, dt=0.04, target=0, head=0, ids=ids, positions=positions, traits=traits, roster=ids,
        joined=(), left=(), field=Field(400.0, 400.0), motion=motion, sensor=sensor, key=derive(5, 1),
    )  # fmt: skip
    seen = Evidence(ids, np.full(5, 9.0), positions, traits)
    pool = Pool(rng.normal(0.0, 20.0, (4, 70)), rng.normal(0.0, 0.3, 70))
    return heads.bootstrap(pool, seen, scene, threshold)


@pytest.mark.parametrize("threshold", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    ("sensor", "of_somebody_else"),
    [
        (AcousticEnergy(), Loud()),
        (AcousticEnergy().assumed("unknown", inflate=True), Loud().assumed("unknown", inflate=True)),
    ],
)
def test_models_of_somebody_else_take_the_kernels_one_by_one_and_give_the_same(
    sensor, of_somebody_else, threshold, monkeypatch
):
    calls = []
    monkeypatch.setattr(heads, "predict_and_score", lambda *given: calls.append(1) or predict_and_score(*given))
    known = filtered(BoundedVelocity(), sensor, threshold)
    assert len(calls) == 1
    other = filtered(Drifting(), of_somebody_else, threshold)
    assert len(calls) == 1, "a subclass may move otherwise"
    filtered(BoundedVelocity(), Loud(), threshold)
    assert len(calls) == 1, "a subclass may measure otherwise"
    filtered(Turned(), sensor, threshold)
    assert len(calls) == 1, "the position may be in other rows"
    assert known.effective == pytest.approx(other.effective, rel=1e-12)
    for a, b in ((known.mean, other.mean), (known.cov, other.cov), (known.pool.cloud, other.pool.cloud)):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12)
