"""IMSF: against the Kalman filter, against a textbook loop on the set-up of Liu and Wang, and by the packet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearMotion, against_kalman, kalman, sent
from tests.kernels.test_relay import chain, combine_by_the_book, mix_by_the_book, update_each_by_the_book
from tests.trackers.test_relay_kalman import Line, losing
from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import Member
from wsnsim.models.linear import ConstantAcceleration
from wsnsim.models.ranging import Range
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.offline.loopback import perform, silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.sensor_chains import InteractingKalman, RelayKalman

EVERY = [InteractingKalman(), InteractingKalman(mixing="printed")]
MIDWAY = (380.0, 3.0, 0.05)


class Textbook:
    """A list of filters, one a sensor, stepped by the twins."""

    def __init__(self, line):
        self.line, self.printed = line, False
        self.means, self.covs = np.repeat(line.prior.mean[:, None], 8, axis=1), np.repeat(line.prior.cov[None], 8, 0)
        self.chances = np.full(8, 0.125)

    def predict(self):
        self.means, self.covs, self.chances = mix_by_the_book(self.means, self.covs, self.chances, 0.93, self.printed)
        moved = [self.line.predicted(self.means[:, i], self.covs[i]) for i in range(8)]
        self.means, self.covs = np.array([mean for mean, _ in moved]).T.copy(), np.array([cov for _, cov in moved])

    def update(self, readings, heard):
        linear = [self.line.linear(x) for x in self.means[0]]
        expected, gradients, variances = (np.stack(values, axis=-1) for values in zip(*linear, strict=True))
        return update_each_by_the_book(
            self.means, self.covs, self.chances, expected, gradients, variances, readings, heard, [0]
        )

    def agrees(self, belief, rel=1e-9):
        for found, value in (
            (belief.means, self.means),
            (belief.covs.transpose(2, 0, 1), self.covs),
            (belief.probabilities, self.chances),
        ):
            assert found == pytest.approx(value, rel=rel, abs=rel)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "start"), [(0, (1.0, 0.1, 0.01)), (1, MIDWAY)])
def test_fifty_steps_on_the_papers_line_are_those_of_a_textbook_loop(seed, start) -> None:
    line, tracker = Line(seed, start), InteractingKalman()
    belief, book = line.start(tracker), Textbook(line)
    for step in range(1, 51):
        belief = line.step(tracker, belief, step)
        book.predict()
        mean, cov = book.update(line.readings(step), np.ones(8, bool))
        book.agrees(belief)
        assert belief.mean == pytest.approx(mean, rel=1e-9) and belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-12)


def test_the_printed_mixing_begins_as_its_textbook_loop_and_diverges_finitely() -> None:
    line, tracker = Line(0), InteractingKalman(mixing="printed")
    belief, book = line.start(tracker), Textbook(line)
    book.printed = True
    for step in range(1, 301):
        belief = line.step(tracker, belief, step)
        if step <= 3:
            book.predict()
            book.update(line.readings(step), np.ones(8, bool))
            book.agrees(belief)
        assert np.all(np.isfinite(belief.mean)) and np.all(np.isfinite(belief.cov))
        assert np.linalg.eigvalsh(belief.cov)[0] >= -1e-9 * np.trace(belief.cov)
    corrected, right = Line(0), InteractingKalman()
    sound = corrected.start(right)
    for step in range(1, 301):
        sound = corrected.step(right, sound, step)
    assert abs(sound.mean[0] - line.truth[-1, 0]) < 5.0
    assert np.sqrt(belief.cov[2, 2]) > 100.0 * np.sqrt(sound.cov[2, 2])


def test_with_one_sensor_it_is_the_kalman_filter() -> None:
    for tracker in EVERY:
        cluster = Cluster(1)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        mean, cov = cluster.prior.mean, cluster.prior.cov
        for step in range(1, 16):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
            mean, cov = kalman(mean, cov, cluster.motion.noise, *cluster.readings())
            assert belief.mean == pytest.approx(mean, rel=1e-9) and belief.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)
            assert belief.probabilities == pytest.approx([1.0])


def test_with_one_sensor_it_is_the_extended_kalman_filter_of_a_motion_that_depends_on_time() -> None:
    line, chained, plain = Line(), InteractingKalman(), ExtendedKalman()
    prior = Estimate(np.array([2.0]), np.array([[1.5]]))
    alone = replace(line.scene(0, line.ids[:1]), motion=Ungm(q=2.0), sensor=Squared())
    beliefs = [perform(tracker.start(prior, alone), {}, alone.head) for tracker in (chained, plain)]
    for step, steps, reading in ((1, 1, 3.0), (3, 2, 6.0), (6, 3, 1.0), (7, 1, 4.0)):
        scene = replace(alone, step=step, steps=steps, time=float(step))
        member = Member(alone.head, line.positions[0], np.empty(0), reading)
        beliefs = [
            perform(tracker.step(belief, scene), {alone.head: member}, alone.head)
            for tracker, belief in zip((chained, plain), beliefs, strict=True)
        ]
        assert beliefs[0].mean == pytest.approx(beliefs[1].mean, rel=1e-9)
        assert beliefs[0].cov == pytest.approx(beliefs[1].cov, rel=1e-9)


def test_where_nothing_mixes_each_filter_is_the_kalman_filter_of_its_own_sensor() -> None:
    cluster, tracker = Cluster(3), InteractingKalman(stay=1.0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    moments = [(cluster.prior.mean, cluster.prior.cov)] * 3
    for step in range(1, 6):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        z, traits = cluster.readings()
        moments = [kalman(*moments[i], cluster.motion.noise, z[i : i + 1], traits[i : i + 1]) for i in range(3)]
    for i, (mean, cov) in enumerate(moments):
        assert belief.means[:, i] == pytest.approx(mean, rel=1e-9) and belief.covs[..., i] == pytest.approx(
            cov, rel=1e-9
        )
    means, covs = np.array([mean for mean, _ in moments]).T, np.array([cov for _, cov in moments])
    expected = combine_by_the_book(means, covs, belief.probabilities)
    assert belief.mean == pytest.approx(expected[0]) and belief.cov == pytest.approx(expected[1])


def test_it_is_less_sure_than_the_kalman_filter_of_all_readings_but_still_a_filter() -> None:
    errors, ratios = against_kalman(InteractingKalman(), seeds=6)
    assert np.median(ratios) > 1.5
    assert np.sqrt(np.mean(errors**2)) < 10.0


@pytest.mark.thorough
def test_on_the_papers_line_its_position_error_is_below_that_of_the_relaying_filter() -> None:
    """Figure 1, in the median over twelve truths."""
    errors = {}
    for tracker in (RelayKalman(), InteractingKalman()):
        found = []
        for seed in range(12):
            line = Line(seed)
            belief = line.start(tracker)
            for step in range(1, 151):
                belief = line.step(tracker, belief, step)
                found.append(abs(belief.mean[0] - line.truth[step, 0]))
        errors[type(tracker)] = np.median(found)
    assert errors[InteractingKalman] < errors[RelayKalman]


def test_a_lost_reading_leaves_its_filter_and_its_probability_predicted() -> None:
    line, tracker = Line(0, MIDWAY), InteractingKalman()
    belief, book = line.start(tracker), Textbook(line)
    for step in (1, 2, 3):
        belief = line.step(tracker, belief, step)
        book.predict()
        book.update(line.readings(step), np.ones(8, bool))
    after = line.step(tracker, belief, 4, losing(1, 8))
    book.predict()
    predicted = book.means.copy(), book.covs.copy(), book.chances.copy()
    lost = [line.ids.index(node) for node in (1, 8)]
    book.update(line.readings(4), np.array([row not in lost for row in range(8)]))
    book.agrees(after)
    assert after.means[:, lost] == pytest.approx(predicted[0][:, lost], rel=1e-12)
    assert after.covs[..., lost].transpose(2, 0, 1) == pytest.approx(predicted[1][lost], rel=1e-12)
    assert after.probabilities[lost] == pytest.approx(predicted[2][lost], rel=1e-12)


def test_with_all_readings_lost_it_mixes_and_predicts() -> None:
    line, tracker = Line(0, MIDWAY), InteractingKalman()
    belief = line.step(tracker, line.start(tracker), 1)
    after = line.step(tracker, belief, 2, losing(*line.ids[1:]), ids=line.ids)  # the head's own arrives
    assert after.probabilities.sum() == pytest.approx(1.0)
    alone = line.step(tracker, belief, 3, losing(*line.ids), ids=line.ids[1:], steps=2)
    assert alone.ids == line.ids[1:]
    b = belief.probabilities[1:] / belief.probabilities[1:].sum()
    assert alone.probabilities == pytest.approx(chain(7, 0.93) @ chain(7, 0.93) @ b, rel=1e-12)
    mean, cov = combine_by_the_book(belief.means[:, 1:], belief.covs[..., 1:].transpose(2, 0, 1), b)
    for _ in range(2):
        mean, cov = line.predicted(mean, cov)
    assert alone.mean == pytest.approx(mean, rel=1e-9), "the motion is linear: a mixture predicts as its moments do"
    assert alone.cov == pytest.approx(cov, rel=1e-9)


def test_a_sensor_that_joins_starts_from_the_mixture_and_while_nobody_senses_the_mixture_predicts() -> None:
    line, tracker = Line(0, MIDWAY), InteractingKalman()
    some = line.ids[:3]
    belief = line.step(tracker, line.step(tracker, line.start(tracker), 1, ids=some), 2, ids=())
    assert belief.ids == ()
    first = line.step(tracker, line.start(tracker), 1, ids=some)
    mean, cov = line.predicted(first.mean, first.cov)
    assert belief.mean == pytest.approx(mean) and belief.cov == pytest.approx(cov)
    back = line.step(tracker, belief, 3, losing(*line.ids), ids=line.ids[1:3])
    mean, cov = line.predicted(mean, cov)
    assert back.means == pytest.approx(np.repeat(mean[:, None], 2, axis=1)) and back.covs == pytest.approx(
        np.repeat(cov[..., None], 2, axis=2)
    )
    assert back.probabilities == pytest.approx([0.5, 0.5])
    joined = line.step(tracker, first, 2, losing(*line.ids), ids=(*some[1:], line.ids[6]))
    b = np.append(first.probabilities[1:] / first.probabilities[1:].sum(), 0.0)
    assert joined.probabilities == pytest.approx(chain(3, 0.93) @ b)
    means = np.column_stack([first.means[:, 1:], first.mean])
    mixed = mix_by_the_book(means, np.array([*first.covs[..., 1:].transpose(2, 0, 1), first.cov]), b, 0.93, False)[0]
    for i in range(3):
        assert joined.means[:, i] == pytest.approx(line.predicted(mixed[:, i], np.eye(3))[0])


@pytest.mark.parametrize(("sensors", "packets"), [(1, 5), (4, 17), (5, 22), (9, 39)])
def test_a_handover_sends_every_filters_moments_and_four_probabilities_to_a_packet(sensors, packets) -> None:
    cluster, tracker = Cluster(sensors), InteractingKalman()
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", packets)]
    assert after.head == 7 and after.ids == belief.ids
    for name in ("mean", "cov", "means", "covs", "probabilities"):
        assert getattr(after, name) == pytest.approx(getattr(belief, name), rel=1e-12), name
    again, _ = cluster.drive(tracker.step(after, cluster.scene(2)))
    assert np.all(np.isfinite(again.cov))


def test_of_a_handover_the_filters_that_arrived_whole_go_on() -> None:
    cluster, tracker = Cluster(5), InteractingKalman()
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    belief = replace(belief, probabilities=np.array([0.1, 0.2, 0.3, 0.15, 0.25]))

    def without(*lost):
        after, _ = cluster.drive(
            tracker.hand_over(belief, scene, 7),
            lambda source, to, parcel: ~np.isin(np.arange(parcel.packets), lost),
        )
        return after

    after = without(0, 7 + 6)  # a packet of the first filter's, one of the fourth's
    assert after.ids == tuple(belief.ids[i] for i in (1, 2, 4))
    assert np.array_equal(after.means, belief.means[:, [1, 2, 4]])
    assert after.probabilities == pytest.approx(np.array([0.2, 0.3, 0.25]) / 0.75)
    expected = combine_by_the_book(after.means, after.covs.transpose(2, 0, 1), after.probabilities)
    assert after.mean == pytest.approx(expected[0]) and after.cov == pytest.approx(expected[1])
    guessed = np.array([0.1875, 0.1875, 0.1875, 0.25])  # four share 0.75, and one of them is gone
    assert without(0, 20).probabilities == pytest.approx(guessed / guessed.sum())
    assert without(0, 4, 8, 12, 16) is None
    assert cluster.drive(tracker.hand_over(belief, scene, 7), silent)[0] is None


def test_a_mixture_without_filters_is_handed_over_by_its_moments() -> None:
    cluster, tracker = Cluster(3), InteractingKalman()
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0, ())))
    after, heard = cluster.drive(tracker.hand_over(belief, cluster.scene(0, ()), 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", 4)]
    assert np.array_equal(after.mean, belief.mean) and after.ids == ()
    assert cluster.drive(tracker.hand_over(belief, cluster.scene(0, ()), 7), silent)[0] is None


def test_a_step_sends_one_reading_per_active_member_but_the_head_and_costs_what_is_counted() -> None:
    cluster, tracker = Cluster(6), InteractingKalman()
    belief, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert heard.packets == []
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert sent(heard, cluster.head) == {"^reading": 5}
    mixing, prediction = 2 * 6 + 6 * (2 + 3 * 4 + 4 * 16), 4 * 64 + 2 * 16
    update, mixture = (2 * 2 * 4 + 2 * 2 + 30) + 3 * 4 + 8 * 16 + 4, 3 * 4 + 4 * 16
    assert heard.cycles == {cluster.head: 6 * (mixing + prediction + update + mixture)}
    relaying = Cluster(6)
    other, _ = relaying.drive(RelayKalman().start(relaying.prior, relaying.scene(0)))
    _, heard_of_rkf = relaying.drive(RelayKalman().step(other, relaying.scene(1)))
    assert heard.cycles[cluster.head] > heard_of_rkf.cycles[cluster.head], "table 1: the better filter costs more"
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(2, ())))
    assert heard.packets == [] and heard.cycles == {cluster.head: prediction}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "tracker", [*EVERY, InteractingKalman(stay=1.0), InteractingKalman(stay=0.0, mixing="printed")], ids=repr
)
def test_it_keeps_the_rules_of_the_seam(tracker) -> None:
    check_tracker(tracker)
    check_tracker(tracker, ConstantAcceleration(), Range(beyond="noise"))
    check_tracker(tracker, LinearMotion(), Range(reach=60.0))
