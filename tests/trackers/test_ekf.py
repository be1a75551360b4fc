"""The extended Kalman filter: the joint Gaussian where everything is linear, the nearest sensor, sharp readings."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearMotion, LinearSensor, kalman, sent
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import Range
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.ekf import ExtendedKalman

EVERY = [ExtendedKalman(), ExtendedKalman(readings="nearest")]


class Sharp(LinearSensor):
    """A linear sensor with a standard deviation of 0.1 mm."""

    def linearise(self, points, positions, traits):
        expected, gradients, variances = super().linearise(points, positions, traits)
        return expected, gradients, np.full(variances.shape, 1e-8)


class Place(LinearSensor):
    """Reads nothing but px, so that who is asked shows in the covariance only by the packet."""

    def draw_traits(self, nodes, rng):
        return np.tile([1.0, 0.0], (nodes, 1))


def test_on_a_linear_gaussian_model_it_is_the_kalman_filter() -> None:
    cluster, tracker = Cluster(5), ExtendedKalman()
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    mean, cov = cluster.prior.mean, cluster.prior.cov
    for step in range(1, 31):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        mean, cov = kalman(mean, cov, cluster.motion.noise, *cluster.readings())
        cov = (cov + cov.T) / 2.0  # rounding makes the truth lopsided, more so from step to step
        assert belief.mean == pytest.approx(mean, rel=1e-9, abs=1e-9)
        assert belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)


def test_readings_that_are_lost_do_not_count() -> None:
    cluster, tracker = Cluster(5), ExtendedKalman()
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    lost = cluster.ids[2:4]
    scene = cluster.scene(1)
    after, _ = cluster.drive(
        tracker.step(belief, scene), lambda source, to, parcel: np.full(parcel.packets, source not in lost)
    )
    readings, traits = cluster.readings()
    kept = [0, 1, 4]
    mean, cov = kalman(cluster.prior.mean, cluster.prior.cov, cluster.motion.noise, readings[kept], traits[kept])
    assert after.mean == pytest.approx(mean, rel=1e-9) and after.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)


def test_it_is_updated_by_the_member_nearest_to_the_prediction_alone_for_a_poll_and_a_packet() -> None:
    cluster, tracker = Cluster(20), ExtendedKalman(readings="nearest")
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    asked = set()
    for step in range(1, 41):
        scene = cluster.scene(step)
        moved, grown = kalman(belief.mean, belief.cov, cluster.motion.noise, np.empty(0), np.empty((0, 2)))
        row = int(np.argmin(np.hypot(*(cluster.positions - moved[[0, 2]]).T)))
        belief, heard = cluster.drive(tracker.step(belief, scene))
        readings, traits = cluster.readings()
        gain_of = np.zeros(4)
        gain_of[[0, 2]] = traits[row]
        gain = grown @ gain_of / (gain_of @ grown @ gain_of + 2.0)
        assert belief.mean == pytest.approx(moved + gain * (readings[row] - gain_of @ moved), rel=1e-9, abs=1e-9)
        assert sent(heard, cluster.head) == ({"vpoll": 1, "^reading": 1} if row else {})
        asked.add(row)
    assert len(asked) > 1, "the target went past more than one"


@pytest.mark.parametrize("tracker", EVERY, ids=["all", "nearest"])
def test_without_a_reading_it_predicts(tracker) -> None:
    cluster = Cluster(4)
    cluster.positions[0] += 1000.0  # the head is not the nearest
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    mean, cov = kalman(belief.mean, belief.cov, cluster.motion.noise, np.empty(0), np.empty((0, 2)))
    for ids in (cluster.ids[1:], ()):
        after, _ = cluster.drive(tracker.step(belief, cluster.scene(1, ids)), silent)
        assert after.mean == pytest.approx(mean) and after.cov == pytest.approx(cov)


def test_sharp_readings_leave_the_covariance_definite_over_many_steps() -> None:
    cluster, tracker = Cluster(8, LinearMotion(1e-10), Sharp()), ExtendedKalman()
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    for step in range(1, 101):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        assert np.array_equal(belief.cov, belief.cov.T)
        assert np.linalg.eigvalsh(belief.cov)[0] > 0.0


@pytest.mark.thorough
def test_on_ranges_its_errors_are_as_large_as_it_says() -> None:
    """The normalised squared error of the state of four, over sixty runs: its mean is 4 if the filter is consistent."""
    motion, sensor = ConstantVelocity(start=(5.0, 1.0, 5.0, -1.0), variances=(0.5,)), Range(sd=0.5, reach=200.0)
    errors = []
    for seed in range(60):
        cluster, tracker = Cluster(6, motion, sensor, seed=seed, reach=60.0), ExtendedKalman()
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        for step in range(1, 31):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        error = belief.mean - cluster.truth[30]
        errors.append(error @ np.linalg.solve(belief.cov, error))
    assert np.mean(errors) == pytest.approx(4.0, abs=4.0 * np.sqrt(8.0 / 60)), "four standard errors"


def test_a_handover_sends_the_moments_and_a_step_costs_what_is_counted() -> None:
    for tracker, readings in zip(EVERY, (6, 1), strict=True):
        cluster = Cluster(6)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        after, heard = cluster.drive(tracker.hand_over(belief, cluster.scene(0), 7))
        assert [packet[1:] for packet in heard.packets] == [(7, "handover", 4)] and after.head == 7
        assert cluster.drive(tracker.hand_over(belief, cluster.scene(0), 7), silent)[0] is None
        _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
        a_reading = (4 * 2 + 2 * 2 * 4 + 20) + 3 * 4 + 8 * 16
        assert heard.cycles == {cluster.head: 4 * 64 + 2 * 16 + readings * a_reading}


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", EVERY, ids=["all", "nearest"])
def test_it_keeps_the_rules_of_the_seam(tracker) -> None:
    check_tracker(tracker)
    check_tracker(tracker, LinearMotion(), Place())
