"""RIS: each fix is its readings' alone."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.range_cluster import Chase, asked, straight
from wsnsim.models.ranging import Range, Rssi
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.range_fixes import AwakeOnly
from wsnsim.trackers.shared.fixes import least_squares

PLACES = [(0.0, 0.0), (40.0, 10.0), (10.0, 45.0), (50.0, 50.0)]
PATH = straight((5.0, 10.0), (3.0, 1.5), 8, 2.0)


def test_what_was_before_makes_no_difference_to_an_estimate_with_readings() -> None:
    chase, tracker = Chase(PATH, PLACES, Range(sd=2.0, reach=1e4)), AwakeOnly()
    early, late = chase.follow(tracker, 1), chase.follow(tracker, 5)
    for ids in (chase.ids, chase.ids[:2], chase.ids[3:]):
        found = [
            tracker.estimate(chase.drive(tracker.step(before, chase.scene(6, ids)))[0]) for before in (early, late)
        ]
        assert np.array_equal(found[0].mean, found[1].mean) and np.array_equal(found[0].cov, found[1].cov)


def test_a_fix_is_least_squares_from_the_middle_of_those_who_read() -> None:
    chase, tracker = Chase(PATH, PLACES, Range(sd=2.0, reach=1e4)), AwakeOnly()
    belief, _ = chase.drive(tracker.step(chase.follow(tracker, 1), chase.scene(2, chase.ids[1:])))
    expected, _ = least_squares(chase.positions[1:], chase.readings()[0], chase.positions[1:].mean(axis=0))
    assert belief.points == (tuple(expected.tolist()),) and belief.mean[[1, 3]].tolist() == [0.0, 0.0]


def test_one_range_gives_the_node_and_two_that_cross_the_middle_of_their_crossings() -> None:
    chase, tracker = Chase(PATH, [(0.0, 0.0), (12.0, 0.0)]), AwakeOnly()
    chase.truth = np.tile([6.0, 0.0, 8.0, 0.0], (9, 1))  # 10 m from both
    before = chase.follow(tracker, 0)
    one, _ = chase.drive(tracker.step(before, chase.scene(1, chase.ids[1:])))
    assert one.mean[[0, 2]] == pytest.approx([12.0, 0.0])
    assert one.cov[np.ix_([0, 2], [0, 2])] == pytest.approx(100.0 * np.eye(2)), "the target is 10 m off"
    two, _ = chase.drive(tracker.step(before, chase.scene(1)))
    assert two.mean[[0, 2]] == pytest.approx([6.0, 0.0], abs=1e-6)
    assert two.cov[2, 2] == pytest.approx(100.0) and two.cov[0, 0] < 1e-6, "across nothing is known"


def test_it_foresees_nothing_and_hands_over_the_last_fix() -> None:
    chase, tracker = Chase(PATH, PLACES), AwakeOnly()
    belief = chase.follow(tracker, 6)
    assert not tracker.foresees(belief) and tracker.belief_bits(belief) == 32
    assert tracker.forecast(belief, chase.scene(6), 3).mean[[0, 2]] == pytest.approx(PATH[6][[0, 2]], abs=1e-4)
    _, (send,) = asked(tracker.hand_over(belief, chase.scene(6), 7), np.array([True]))
    assert (send.parcel.packets, send.parcel.packet_bits) == (1, 88)
    assert chase.drive(tracker.hand_over(belief, chase.scene(6), 7), silent)[0] is None


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", [Range(), Range(sd=50.0), Rssi(), Rssi(sd=30.0)])
def test_the_rules_of_the_seam_are_kept(sensor) -> None:
    check_tracker(AwakeOnly(), sensor=sensor)
