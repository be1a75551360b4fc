"""A step of the bootstrap filter in one kernel call, against NumPy and against the kernels called one by one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import twins
from tests.bench.entries import ENTRIES
from wsnsim.base.ports import Field, Scene
from wsnsim.base.rng import derive, uniforms
from wsnsim.kernels.bootstrap_step import step
from wsnsim.kernels.particles import summarise, update
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.trackers.shared import heads
from wsnsim.trackers.shared.dealing import Pool
from wsnsim.trackers.shared.readings import Evidence

ARGUMENTS = {entry.kernel: entry.arguments for entry in ENTRIES}


def summarise_twin(cloud, log_weights):
    everyone = np.array([0, log_weights.size])
    effective = twins.weigh(log_weights, everyone)
    means, covs = twins.moments(cloud, log_weights, everyone)
    return means[0], covs[0], effective[0]


def update_twin(cloud, log_weights, scores, least, key, draw):
    scores += log_weights
    mean, cov, effective = summarise_twin(cloud, scores)
    if effective >= least:
        return cloud, scores, mean, cov, effective
    everyone, size = np.array([0, scores.size]), np.array([scores.size])
    chosen = twins.systematic(scores, everyone, size, uniforms(np.array([key], np.uint64), draw))
    return cloud[:, chosen], np.zeros(scores.size), mean, cov, effective


def step_twin(
    cloud, log_weights, key, predict, tooth, steps, drift, root, readings, positions, gains, law, least
):  # fmt: skip
    everyone = np.array([0, log_weights.size])
    for passed in range(steps):
        keys = twins.particle_keys(np.array([key], np.uint64), everyone, predict + passed)
        cloud = twins.propagate(cloud, keys, drift, root)
    scores = twins.joint_log_likelihood(cloud[0], cloud[2], readings, positions, gains, law)
    return update_twin(cloud, log_weights, scores, least, key, tooth)


def equal(found, expected):
    """Whether clouds, weights (those of a kernel may be zero where they are tiny) and moments agree."""
    (cloud, log_weights, *moments), (other, other_weights, *other_moments) = found, expected
    pairs = [(cloud, other), (np.exp(log_weights), np.exp(other_weights)), *zip(moments, other_moments, strict=True)]
    return all(np.allclose(a, b, rtol=1e-8, atol=1e-8) for a, b in pairs)


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("least", [0.0, 60.0, np.inf])
def test_a_step_is_that_of_numpy(steps, least):
    cloud, log_weights, key, predict, tooth, _, *constants, _ = ARGUMENTS["bootstrap_step.step"](60)
    log_weights += np.linspace(-1.0, 1.0, 60)
    arguments = (cloud, log_weights, key, predict, tooth, steps, *constants, least)
    assert equal(step(*arguments), step_twin(*arguments))


def test_particles_that_are_effective_enough_are_kept():
    cloud, log_weights, scores, _, key, draw = ARGUMENTS["particles.update"](50)
    kept, weights, _, _, effective = update(cloud, log_weights, scores, 1.0, key, draw)
    assert kept is not None and np.array_equal(kept, cloud) and weights.any() and 1.0 <= effective < 50.0
    _, weights, _, _, _ = update(cloud, log_weights, scores, effective * 1.1, key, draw)
    assert not weights.any()


@pytest.mark.parametrize("hopeless", [-np.inf, np.nan])
def test_where_no_particle_is_likely_all_weigh_the_same(hopeless):
    cloud, log_weights = ARGUMENTS["particles.summarise"](20)
    log_weights[:] = hopeless
    mean, _, effective = summarise(cloud, log_weights)
    assert mean == pytest.approx(cloud.mean(axis=1)) and effective == 0.0 and not log_weights.any()


class Drifting(BoundedVelocity):
    """A motion model of somebody else, who inherits and has a way of its own to move."""

    def propagate(self, states, dt, keys, time=0.0):
        return super().propagate(states, dt, keys, time)


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
    monkeypatch.setattr(heads, "step", lambda *arguments: calls.append(1) or step(*arguments))
    known = filtered(BoundedVelocity(), sensor, threshold)
    assert len(calls) == 1
    other = filtered(Drifting(), of_somebody_else, threshold)
    assert len(calls) == 1, "a subclass may move otherwise"
    filtered(BoundedVelocity(), Loud(), threshold)
    assert len(calls) == 1, "a subclass may measure otherwise"
    assert known.effective == pytest.approx(other.effective, rel=1e-12)
    for a, b in ((known.mean, other.mean), (known.cov, other.cov), (known.pool.cloud, other.pool.cloud)):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12)
