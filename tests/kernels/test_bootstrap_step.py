"""Prediction and scores of a bootstrap filter in one kernel call, against NumPy and against kernels one by one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import twins
from tests.bench.entries import ENTRIES
from wsnsim.base.ports import Field, Scene
from wsnsim.base.rng import derive
from wsnsim.kernels.bootstrap_step import predict_and_score
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.trackers.shared import heads
from wsnsim.trackers.shared.dealing import Pool
from wsnsim.trackers.shared.readings import Evidence

ARGUMENTS = {entry.kernel: entry.arguments for entry in ENTRIES}


def predict_and_score_twin(cloud, key, tag, steps, drift, root, readings, positions, gains, law):
    everyone = np.array([0, cloud.shape[1]])
    for passed in range(steps):
        keys = twins.particle_keys(np.array([key], np.uint64), everyone, tag + passed)
        cloud = twins.propagate(cloud, keys, drift, root)
    return cloud, twins.joint_log_likelihood(cloud[0], cloud[2], readings, positions, gains, law)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_a_prediction_and_its_scores_are_those_of_numpy(steps):
    cloud, key, tag, _, *constants = ARGUMENTS["bootstrap_step.predict_and_score"](60)
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
