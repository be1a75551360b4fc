"""RKF: against the joint Gaussian, against a textbook loop on the set-up of Liu and Wang, and by the packet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearMotion, against_kalman, kalman, sent
from tests.helpers.scenes import make_scene
from tests.kernels.test_relay import chain, kalman_by_the_book, rkf_by_the_book
from wsnsim.base.arrays import Estimate
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Member
from wsnsim.models.linear import ConstantAcceleration
from wsnsim.models.ranging import Range
from wsnsim.offline.loopback import perfect, perform, silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.sensor_chains import RelayKalman, carried, stay_after
from wsnsim.trackers.shared.readings import arrived_probabilities

ANCHORS = (-1.0, 150.0, 300.0, 450.0, 600.0, 750.0, 900.0, 1000.0)
F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
Q = 1e-6 * np.outer([0.5, 1.0, 1.0], [0.5, 1.0, 1.0])
EVERY = [RelayKalman(), RelayKalman(spread=True)]


class Line:
    """The eight sensors of Liu and Wang along a line, with a reading each at each step, out of reach or not."""

    def __init__(self, seed: int = 0, start: tuple[float, float, float] = (1.0, 0.1, 0.01)) -> None:
        rng = np.random.default_rng(seed)
        self.motion, self.sensor = ConstantAcceleration(start=start), Range(beyond="noise")
        self.truth = self.motion.truth(300, 1.0, rng)
        self.positions = np.array([[x, 10.0] for x in ANCHORS])
        self.noise = rng.normal(size=(301, 8))
        self.ids = (5, 3, 8, 1, 9, 2, 7, 4)
        deviations = np.array([1.0, 0.1, 0.01])
        self.prior = Estimate(self.truth[0] + deviations * rng.normal(size=3), np.diag(deviations**2))

    def readings(self, step: int) -> np.ndarray:
        """(8,) by the paper's words, not by the model: the distance up to 400 m, else nothing but noise."""
        distance = np.hypot(self.truth[step, 0] - self.positions[:, 0], self.positions[:, 1])
        return np.where(distance <= 400.0, distance, 0.0) + self.noise[step]

    def scene(self, step: int, ids=None, steps: int = 1) -> Scene:
        ids = self.ids if ids is None else ids
        rows = [self.ids.index(node) for node in ids]
        return make_scene(
            step, ids, self.positions[rows], np.empty((len(rows), 0)), self.motion, self.sensor, steps=steps,
            head=self.ids[0], roster=self.ids,
        )  # fmt: skip

    def start(self, tracker):
        return perform(tracker.start(self.prior, self.scene(0)), {}, self.ids[0])

    def step(self, tracker, belief, step, lose=perfect, ids=None, steps=1):
        scene, values = self.scene(step, ids, steps), self.readings(step)
        members = {
            node: Member(node, self.positions[row], np.empty(0), float(values[row]) if node in scene.ids else None)
            for row, node in enumerate(self.ids)
        }
        return perform(tracker.step(belief, scene), members, self.ids[0], lose)

    def predicted(self, mean, cov):
        return F @ mean, F @ cov @ F.T + Q

    def linear(self, x):
        """Distances from x (8,), their slopes (8, 1) and variances (8,)."""
        distance = np.hypot(x - self.positions[:, 0], self.positions[:, 1])
        return distance, ((x - self.positions[:, 0]) / distance)[:, None], np.ones(8)


def losing(*nodes):
    """A network that loses whatever these send."""
    return lambda source, to, parcel: np.full(parcel.packets, source not in nodes)


@pytest.mark.thorough
@pytest.mark.parametrize("spread", [False, True])
def test_fifty_steps_on_the_papers_line_are_those_of_a_textbook_loop(spread) -> None:
    for seed, start in ((0, (1.0, 0.1, 0.01)), (1, (380.0, 3.0, 0.05))):
        line, tracker = Line(seed, start), RelayKalman(spread=spread)
        belief, (mean, cov), chances = line.start(tracker), (line.prior.mean, line.prior.cov), np.full(8, 0.125)
        for step in range(1, 51):
            belief = line.step(tracker, belief, step)
            mean, cov = line.predicted(mean, cov)
            mean, cov, chances = rkf_by_the_book(
                mean, cov, chances, *line.linear(mean[0]), line.readings(step), np.ones(8, bool), [0], 0.93, spread
            )
            assert belief.mean == pytest.approx(mean, rel=1e-9, abs=1e-9)
            assert belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-12)
            assert belief.probabilities == pytest.approx(chances, rel=1e-9, abs=1e-12)
            assert belief.ids == line.ids


def test_the_probability_moves_along_the_line_with_the_target_that_is_followed_to_the_end() -> None:
    """Beyond reach a sensor reads noise, and has no probability; this truth stays within reach of somebody."""
    line, tracker = Line(3), RelayKalman()
    belief = line.start(tracker)
    for step in range(1, 301):
        belief = line.step(tracker, belief, step)
        near = np.abs(line.truth[step, 0] - line.positions[:, 0]) < 400.0
        assert near.any() and belief.probabilities[~near].max(initial=0.0) < 1e-9
    assert line.truth[-1, 0] > 300.0, "it has left the reach of the first sensor's neighbours"
    assert abs(belief.mean[0] - line.truth[-1, 0]) < 10.0


@pytest.mark.parametrize("tracker", EVERY, ids=["literal", "spread"])
def test_with_one_sensor_it_is_the_kalman_filter(tracker) -> None:
    cluster = Cluster(1)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    mean, cov = cluster.prior.mean, cluster.prior.cov
    for step in range(1, 16):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        mean, cov = kalman(mean, cov, cluster.motion.noise, *cluster.readings())
        assert belief.mean == pytest.approx(mean, rel=1e-9) and belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)
        assert belief.probabilities == pytest.approx([1.0])


@pytest.mark.parametrize("tracker", [RelayKalman(stay=1.0), RelayKalman(stay=1.0, spread=True)])
def test_with_the_probability_forced_to_one_sensor_it_is_the_kalman_filter_of_that_one(tracker) -> None:
    cluster = Cluster(4)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    belief = replace(belief, probabilities=np.eye(4)[2])
    mean, cov = cluster.prior.mean, cluster.prior.cov
    for step in range(1, 16):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        readings, traits = cluster.readings()
        mean, cov = kalman(mean, cov, cluster.motion.noise, readings[2:3], traits[2:3])
        assert belief.mean == pytest.approx(mean, rel=1e-9) and belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)


def test_one_reading_in_effect_leaves_it_less_sure_than_the_kalman_filter_of_all_but_still_a_filter() -> None:
    errors, ratios = against_kalman(RelayKalman(), seeds=6)
    assert np.median(ratios) > 1.5
    assert np.sqrt(np.mean(errors**2)) < 10.0


def test_a_lost_reading_keeps_its_predicted_probability_and_the_rest_share_the_remainder() -> None:
    line, tracker = Line(0, (380.0, 3.0, 0.0)), RelayKalman()
    belief = line.start(tracker)
    for step in (1, 2, 3):
        belief = line.step(tracker, belief, step)
    lost = [line.ids.index(node) for node in (1, 8)]
    heard = np.array([row not in lost for row in range(8)])
    after = line.step(tracker, belief, 4, losing(1, 8))
    mean, cov = line.predicted(belief.mean, belief.cov)
    expected = rkf_by_the_book(
        mean, cov, belief.probabilities, *line.linear(mean[0]), line.readings(4), heard, [0], 0.93, False
    )
    for found, value in zip((after.mean, after.cov, after.probabilities), expected, strict=True):
        assert found == pytest.approx(value, rel=1e-9, abs=1e-12)
    predicted = chain(8, 0.93) @ belief.probabilities
    assert after.probabilities[lost] == pytest.approx(predicted[lost], rel=1e-12) and predicted[lost].max() > 0.02


@pytest.mark.parametrize("ids", [None, ()], ids=["all lost", "nobody senses"])
def test_without_any_reading_it_predicts(ids) -> None:
    line, tracker = Line(2, (380.0, 3.0, 0.0)), RelayKalman(spread=True)
    belief = line.step(tracker, line.start(tracker), 1)
    after = line.step(tracker, belief, 2, losing(*line.ids[1:]), ids=line.ids[1:] if ids is None else ids)
    mean, cov = line.predicted(belief.mean, belief.cov)
    assert after.mean == pytest.approx(mean, rel=1e-12) and after.cov == pytest.approx(cov, rel=1e-12)
    if ids is None:
        b = belief.probabilities[1:]
        assert after.probabilities == pytest.approx(chain(7, 0.93) @ (b / b.sum()), rel=1e-12)
    else:
        assert after.ids == () and after.probabilities.size == 0


def test_two_missed_steps_are_two_predictions_and_two_steps_of_the_chain() -> None:
    line, tracker = Line(2, (380.0, 3.0, 0.0)), RelayKalman()
    belief = line.step(tracker, line.start(tracker), 1)
    after = line.step(tracker, belief, 4, steps=3)
    mean, cov = belief.mean, belief.cov
    for _ in range(3):
        mean, cov = line.predicted(mean, cov)
    before = chain(8, 0.93) @ chain(8, 0.93) @ belief.probabilities
    expected = rkf_by_the_book(
        mean, cov, before, *line.linear(mean[0]), line.readings(4), np.ones(8, bool), [0], 0.93, False
    )
    for found, value in zip((after.mean, after.cov, after.probabilities), expected, strict=True):
        assert found == pytest.approx(value, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("stay", [0.0, 0.3, 0.93, 1.0])
@pytest.mark.parametrize("sensors", [1, 2, 8])
def test_the_chain_over_several_steps_is_the_power_of_its_matrix(stay, sensors) -> None:
    for steps in (1, 2, 5):
        power = np.linalg.matrix_power(chain(sensors, stay), steps)
        assert chain(sensors, stay_after(stay, sensors, steps)) == pytest.approx(power, abs=1e-14)


def test_who_joins_enters_with_nothing_and_who_leaves_leaves_its_share_to_the_rest() -> None:
    b = np.array([0.2, 0.5, 0.3])
    assert carried((7, 3, 9), b, (7, 3, 9)) is b
    assert carried((7, 3, 9), b, (9, 7, 3)) == pytest.approx([0.3, 0.2, 0.5])
    assert carried((7, 3, 9), b, (9, 1, 7)) == pytest.approx([0.6, 0.0, 0.4])
    assert carried((7, 3, 9), np.array([0.0, 1.0, 0.0]), (1, 9, 7)) == pytest.approx([0.0, 0.5, 0.5])
    assert carried((7, 3, 9), b, (1, 2)) == pytest.approx([0.5, 0.5])
    assert carried((), np.empty(0), (1, 2, 3, 4)) == pytest.approx(np.full(4, 0.25))
    assert carried((7, 3, 9), b, ()).size == 0


@pytest.mark.parametrize(("sensors", "packets"), [(1, 5), (4, 5), (5, 6), (9, 7)])
def test_a_handover_sends_the_moments_and_four_probabilities_to_a_packet(sensors, packets) -> None:
    cluster, tracker = Cluster(sensors), RelayKalman()
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", packets)]
    assert after.head == 7 and after.ids == belief.ids
    for name in ("mean", "cov", "probabilities"):
        assert np.array_equal(getattr(after, name), getattr(belief, name))


def test_of_a_handover_the_moments_must_arrive_whole_and_lost_probabilities_share_what_is_missing() -> None:
    cluster, tracker = Cluster(6), RelayKalman()
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    belief = replace(belief, probabilities=np.array([0.1, 0.2, 0.3, 0.1, 0.25, 0.05]))
    for lost in range(6):
        mask = np.arange(6) != lost
        after, _ = cluster.drive(tracker.hand_over(belief, scene, 7), lambda source, to, parcel, mask=mask: mask)
        if lost < 4:
            assert after is None
        else:
            expected = [0.175] * 4 + [0.25, 0.05] if lost == 4 else [0.1, 0.2, 0.3, 0.1, 0.15, 0.15]
            assert after.probabilities == pytest.approx(expected)
            assert np.array_equal(after.mean, belief.mean) and np.array_equal(after.cov, belief.cov)
    assert cluster.drive(tracker.hand_over(belief, scene, 7), silent)[0] is None
    assert arrived_probabilities(np.array([0.3, 0.7]), np.array([False])) == pytest.approx([0.5, 0.5])


def test_a_step_sends_one_reading_per_active_member_but_the_head_and_costs_what_is_counted() -> None:
    for tracker, square in ((RelayKalman(), 8), (RelayKalman(spread=True), 11)):
        cluster = Cluster(6)
        belief, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        assert heard.packets == []
        belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
        assert sent(heard, cluster.head) == {"^reading": 5}
        a_sensor = 2 * 6 + 4 + (2 * 2 * 4 + 2 * 2 + 30) + 3 * 4 + square * 16
        assert heard.cycles == {cluster.head: 4 * 64 + 2 * 16 + 6 * a_sensor}
        belief, heard = cluster.drive(tracker.step(belief, cluster.scene(2, ())))
        assert heard.packets == [] and heard.cycles == {cluster.head: 4 * 64 + 2 * 16}
        assert tracker.member_cycles == 0.0


def test_the_joint_update_of_one_sensor_is_the_step_of_a_chain_of_one() -> None:
    """The twins agree with each other, so that they can be trusted where they stand for the paper."""
    mean, cov = np.array([1.0, 0.1, 0.01]), np.diag([1.0, 0.01, 1e-4])
    linear = np.array([10.0]), np.array([[0.4]]), np.array([1.0]), np.array([11.0])
    first = rkf_by_the_book(mean, cov, np.ones(1), *linear, np.ones(1, bool), [0], 0.93, True)
    for found, value in zip(first, kalman_by_the_book(mean, cov, *linear, [0]), strict=False):
        assert found == pytest.approx(value, rel=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", [*EVERY, RelayKalman(stay=1.0), RelayKalman(stay=0.0)], ids=repr)
def test_it_keeps_the_rules_of_the_seam(tracker) -> None:
    check_tracker(tracker)
    check_tracker(tracker, ConstantAcceleration(), Range(beyond="noise"))
    check_tracker(tracker, LinearMotion(), Range(reach=60.0))
