"""Trackers of several targets as pure functions of scans: against plain filters, and what no result depends on."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.scenes import make_scene
from tests.helpers.target_scans import MOTION, driven, facts_of, prior_of, ring, scans_of, straight
from wsnsim.base.requests import GatheredReadings, GatherReadings
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.ranging import Range
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.imm import InteractingModels
from wsnsim.trackers.multi_target.lmb import Lmb
from wsnsim.trackers.multi_target.management import KnownTargets
from wsnsim.trackers.multi_target.mht import Mht
from wsnsim.trackers.multi_target.single_gaussian import Gnn, Jpda, LocalNearestNeighbour, Pda
from wsnsim.trackers.sigma_points import CubatureKalman, UnscentedKalman

METHODS = [LocalNearestNeighbour, Gnn, Pda, Jpda, Lmb, Mht]
FILTERS = [ExtendedKalman(), UnscentedKalman(), CubatureKalman(), InteractingModels()]
SENSORS = [Range(sd=1.0, reach=1e3), Bearing(sd=0.02, reach=1e3), RangeBearing(range_sd=1.0, reach=1e3)]
NAMED = {"ids": lambda value: type(value).__name__ if not isinstance(value, type) else value.__name__}


def by_step(facts, truth, nodes, seed, low=0.0, high=150.0):
    rng = np.random.default_rng(seed)
    return [scans_of(truth, step, nodes, facts, rng, low, high) for step in range(1, len(truth))]


def answered(flow, ids, values):
    """What a flow of a filter in a head returns, whose only requests are readings and operations."""
    reply = None
    while True:
        try:
            asked = flow.send(reply)
        except StopIteration as done:
            return done.value
        reply = GatheredReadings(ids, values) if isinstance(asked, GatherReadings) else None


@pytest.mark.parametrize("sensor", SENSORS, **NAMED)
@pytest.mark.parametrize("plain", FILTERS, **NAMED)
def test_with_one_certain_target_each_method_is_the_plain_filter(plain, sensor) -> None:
    nodes, facts = ring(4), facts_of(sensor, probability=1.0, clutter=0.0)
    truth = straight([[-10.0, 2.0, 5.0, -1.0]], 6)
    every, prior = by_step(facts, truth, nodes, 3), prior_of(truth[0, 0], rng=np.random.default_rng(1))
    scenes = [make_scene(step, nodes.ids, nodes.positions, nodes.traits, MOTION, sensor) for step in range(7)]
    beliefs = [answered(plain.start(prior, scenes[0]), (), None)]
    for step, scans in enumerate(every, 1):
        values = np.array([scan.detections[0] for scan in scans])
        values = values if values.shape[1] > 1 else values[:, 0]
        beliefs.append(answered(plain.step(beliefs[-1], scenes[step]), nodes.ids, values))
    for method in METHODS:
        tracker = method(filter=plain, management=KnownTargets(), gate=1.0)
        outcomes = driven(tracker, tracker.begin([prior], 0.0, facts), every, nodes, facts)
        for outcome, belief in zip(outcomes, beliefs[1:], strict=True):
            (found,), expected = tracker.estimates(outcome.belief, facts), plain.estimate(belief)
            assert found.mean == pytest.approx(expected.mean, abs=1e-9, rel=1e-9), method.__name__
            assert found.cov == pytest.approx(expected.cov, abs=1e-9, rel=1e-9), method.__name__
            assert np.concatenate(outcome.explained) == pytest.approx(1.0)
