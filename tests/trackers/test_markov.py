"""TSSTP: the fix is sought about the last fix, and the last fix is the forecast."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.helpers.range_cluster import Chase, asked, straight
from wsnsim.base.requests import Compute
from wsnsim.models.linear import ConstantAcceleration
from wsnsim.models.ranging import Range, Rssi
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.range_fixes import TwoPhase
from wsnsim.trackers.shared.fixes import fix_cycles, least_squares

PLACES = [(0.0, 0.0), (40.0, 10.0), (10.0, 45.0), (50.0, 50.0)]
PATH = straight((5.0, 10.0), (3.0, 1.5), 8, 2.0)


def test_the_forecast_is_the_last_fix_however_far_ahead_and_grows_less_certain() -> None:
    chase, tracker = Chase(PATH, PLACES), TwoPhase()
    belief = chase.follow(tracker, 5)
    estimate = tracker.estimate(belief)
    assert estimate.mean == pytest.approx(PATH[5], abs=1e-4), "with the heading of the last two fixes"
    spreads = [np.trace(estimate.cov)]
    for ahead in (1, 2, 5):
        found = tracker.forecast(belief, chase.scene(5), ahead)
        assert found.mean[[0, 2]] == pytest.approx(PATH[5][[0, 2]], abs=1e-4)
        off = np.hypot(*(PATH[5] - PATH[0])[[0, 2]]) / 5 * ahead
        assert np.trace(found.cov) > off**2, "the target that goes on is within its deviation"
        spreads.append(np.trace(found.cov))
    assert sorted(spreads) == spreads


def test_fixes_are_those_of_least_squares_from_the_last() -> None:
    chase, tracker = Chase(PATH, PLACES, Range(sd=2.0, reach=1e4)), TwoPhase()
    before = chase.follow(tracker, 3)
    for ids in (chase.ids, chase.ids[1:3], chase.ids[2:3]):
        after, _ = chase.drive(tracker.step(before, chase.scene(4, ids)))
        rows = [chase.ids.index(node) for node in ids]
        expected, _ = least_squares(chase.positions[rows], chase.readings()[0], np.array(before.points[-1]))
        assert after.points == (before.points[-1], tuple(expected.tolist()))


def test_a_handover_is_a_packet_of_17_bytes_and_two_positions_are_8() -> None:
    chase, tracker = Chase(PATH, PLACES), TwoPhase()
    belief = chase.follow(tracker, 3)
    _, (send,) = asked(tracker.hand_over(belief, chase.scene(3), 7), np.array([True]))
    assert (send.parcel.packets, send.parcel.packet_bits) == (1, 136) and tracker.belief_bits(belief) == 64
    assert chase.drive(tracker.hand_over(belief, chase.scene(3), 7), silent)[0] is None
    assert chase.drive(tracker.hand_over(belief, chase.scene(3), 7))[0].points == belief.points


def test_a_step_costs_its_fix_and_a_displacement() -> None:
    chase, tracker = Chase(PATH, PLACES), TwoPhase()
    belief = chase.follow(tracker, 1)
    for count in (1, 2):
        _, heard = chase.drive(tracker.step(belief, chase.scene(2, chase.ids[:count])))
        assert heard.cycles == {chase.head: fix_cycles(count, 1) + 2.0}
    _, asks = asked(tracker.step(belief, chase.scene(2)))
    assert [ask.cycles for ask in asks if isinstance(ask, Compute)] == [2.0]


@pytest.mark.thorough
def test_it_needs_a_plane_and_keeps_the_rules_of_the_seam() -> None:
    (issue,) = TwoPhase().check(SimpleNamespace(filter_motions=(ConstantAcceleration(),)))
    assert issue.path == ("tracker", "kind")
    for sensor in (Range(), Range(sd=50.0), Rssi()):
        check_tracker(TwoPhase(), sensor=sensor)
