"""GMTT: exact fixes and their forecast, too few fixes, steps without readings, the field's edge, packets and cycles."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.helpers.range_cluster import Chase, asked, straight
from wsnsim.base.requests import Compute, Send
from wsnsim.kernels.grey import equal_intervals, forecast
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.range_fixes import GreyTracking, grey_cycles, line_cycles
from wsnsim.trackers.shared.fixes import fix_cycles

PLACES = [(0.0, 0.0), (40.0, 10.0), (10.0, 45.0), (50.0, 50.0), (-20.0, 30.0)]
PATH = straight((5.0, 10.0), (3.0, 1.5), 12, 2.0)


def test_fixes_are_exact_where_ranges_are_and_the_velocity_is_theirs() -> None:
    chase, tracker = Chase(PATH, PLACES), GreyTracking()
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    for step in range(1, 9):
        belief, _ = chase.drive(tracker.step(belief, chase.scene(step)))
        found = tracker.estimate(belief)
        assert found.mean == pytest.approx(PATH[step], abs=1e-4)
    assert np.linalg.eigvalsh(found.cov)[0] >= -1e-18
    assert belief.times == (8.0, 10.0, 12.0, 14.0, 16.0), "the last five"


def test_the_forecast_is_the_grey_model_of_each_axis_at_the_fractional_index() -> None:
    """Fixes at 0, 2, 4, 8 and 12 s, the prior's the first: Δ = 3 s, and 14 s is at h = 14/3, two steps on at 16/3."""
    chase, tracker = Chase(PATH, PLACES), GreyTracking(shift=400.0)
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    for step in (1, 2, 4, 6):
        belief, _ = chase.drive(tracker.step(belief, chase.scene(step, steps=1 if step < 3 else 2)))
    scene = chase.scene(6)
    for ahead in (1, 2):
        expected = [
            forecast(equal_intervals([0, 2, 4, 8, 12], axis), ahead * 2.0 / 3.0, 400.0, "tail")
            for axis in PATH[[0, 1, 2, 4, 6]][:, [0, 2]].T
        ]
        found = tracker.forecast(belief, scene, ahead)
        assert found.mean[[0, 2]] == pytest.approx(expected, abs=1e-3)
        assert found.mean[[0, 2]] == pytest.approx(PATH[6 + ahead][[0, 2]], abs=1.5), "near the truth, 6.7 m a step"
        assert np.array_equal(found.cov, found.cov.T) and np.linalg.eigvalsh(found.cov)[0] > 0.0


def test_fewer_than_four_fixes_predict_where_the_target_was_last() -> None:
    chase, tracker = Chase(PATH, PLACES), GreyTracking()
    for fixes in range(1, 6):
        belief = chase.follow(tracker, fixes - 1)
        point = tracker.forecast(belief, chase.scene(fixes - 1), 1).mean[[0, 2]]
        last, coming = PATH[fixes - 1][[0, 2]], PATH[fixes][[0, 2]]
        assert tracker.foresees(belief) == (fixes >= 4)
        assert point == pytest.approx(coming if fixes >= 4 else last, abs=0.5 if fixes >= 4 else 1e-4)
        assert np.hypot(*(coming - last)) > 6.0


def test_the_linear_predictor_is_the_least_squares_line_of_the_fixes_at_their_own_times() -> None:
    """Fixes at 0, 2, 4, 8 and 12 s of a path with a bend, so that equal intervals would give another line."""
    path = PATH.copy()
    path[5:, 0] += 4.0
    chase, tracker = Chase(path, PLACES), GreyTracking(predictor="linear")
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    for step in (1, 2, 4, 6):
        belief, _ = chase.drive(tracker.step(belief, chase.scene(step, steps=1 if step < 3 else 2)))
    for ahead in (1, 2):
        found = tracker.forecast(belief, chase.scene(6), ahead).mean[[0, 2]]
        times, points = [0, 2, 4, 8, 12], path[[0, 1, 2, 4, 6]][:, [0, 2]]
        expected = [np.polyval(np.polyfit(times, axis, 1), 12.0 + 2.0 * ahead) for axis in points.T]
        assert found == pytest.approx(expected, abs=1e-3)
    other = GreyTracking(predictor="linear", shift=0.0, correction="literal")
    assert other.forecast(belief, chase.scene(6), 1).mean[[0, 2]] == pytest.approx(
        tracker.forecast(belief, chase.scene(6), 1).mean[[0, 2]]
    ), "shift and correction are of the grey model"


def test_on_noisy_straight_motion_the_line_predicts_best_and_the_grey_model_as_printed_worst() -> None:
    """Mean error 10 s ahead of five fixes with errors of 1.5 m, 10 s apart, on 300 straight paths about the origin."""
    rng = np.random.Generator(np.random.Philox(12))
    middles, courses = rng.uniform(-60.0, 60.0, (300, 2)), rng.uniform(-4.0, 4.0, (300, 2))
    times = 10.0 * np.arange(6)
    truth = middles[:, None] + (times[:, None] - 25.0) * courses[:, None]
    fixes = truth[:, :5] + 1.5 * rng.standard_normal((300, 5, 2))
    errors = {}
    for name, tracker in (
        ("line", GreyTracking(predictor="linear")),
        ("repaired", GreyTracking()),
        ("literal", GreyTracking(shift=0.0, correction="literal")),
    ):
        at = tuple(times[:5].tolist())
        axes = [[tracker._extrapolated(50.0, at, tuple(axis)) for axis in points.T.tolist()] for points in fixes]
        errors[name] = np.hypot(*(np.array(axes) - truth[:, 5]).T).mean()
    assert errors["line"] == pytest.approx(1.5 * np.sqrt(1.1 * np.pi / 2.0), rel=0.1), "the closed form"
    assert 1.5 * errors["line"] < errors["repaired"] < 0.2 * errors["literal"], errors


@pytest.mark.parametrize("correction", ["tail", "literal", "none"])
def test_a_prediction_stays_in_the_field(correction: str) -> None:
    path = straight((150.0, -170.0), (8.0, -4.0), 8, 2.0)
    chase, tracker = Chase(path, np.add(PLACES, (180.0, -190.0))), GreyTracking(correction=correction)
    belief = chase.follow(tracker, 4)
    found = tracker.forecast(belief, chase.scene(4), 3).mean[[0, 2]]
    assert found.tolist() == [200.0, -200.0], "400 m by 400 m about the origin"


def test_without_readings_the_fixes_stay_and_the_spread_grows() -> None:
    chase, tracker = Chase(PATH, PLACES, Range(sd=1.0, reach=1e4)), GreyTracking()
    before = chase.follow(tracker, 5)
    foretold = tracker.forecast(before, chase.scene(5), 1)
    after, heard = chase.drive(tracker.step(before, chase.scene(6, ())))
    assert (after.times, after.points) == (before.times, before.points) and heard.packets == []
    assert tracker.estimate(after).mean == pytest.approx(foretold.mean) and after.cov == pytest.approx(foretold.cov)
    again, _ = chase.drive(tracker.step(after, chase.scene(7, ())))
    traces = [np.trace(belief.cov[np.ix_([0, 2], [0, 2])]) for belief in (before, after, again)]
    assert traces[0] < traces[1] < traces[2]
    back, _ = chase.drive(tracker.step(again, chase.scene(8)))
    assert back.times == (4.0, 6.0, 8.0, 10.0, 16.0)


def test_reporting_the_prediction_gives_what_had_been_foretold() -> None:
    chase, tracker = Chase(PATH, PLACES, Range(sd=1.0, reach=1e4)), GreyTracking(report="prediction")
    plain = GreyTracking()
    early = chase.follow(tracker, 3)
    assert np.array_equal(tracker.estimate(early).mean, plain.estimate(early).mean), "nothing had been foretold"
    belief = chase.follow(tracker, 5)
    foretold = tracker.forecast(belief, chase.scene(5), 1)
    after, _ = chase.drive(tracker.step(belief, chase.scene(6)))
    assert tracker.estimate(after).mean == pytest.approx(foretold.mean)
    assert tracker.estimate(after).cov == pytest.approx(foretold.cov)
    assert np.abs(plain.estimate(after).mean - foretold.mean).max() > 0.01


def test_with_one_and_two_ranges_it_is_the_solution_nearest_to_the_prediction() -> None:
    chase, tracker = Chase(PATH, PLACES), GreyTracking()
    before = chase.follow(tracker, 5)
    expected = tracker.forecast(before, chase.scene(5), 1).mean[[0, 2]]
    truth = PATH[6][[0, 2]]
    after, _ = chase.drive(tracker.step(before, chase.scene(6, chase.ids[1:3])))
    assert after.mean[[0, 2]] == pytest.approx(truth, abs=1e-4)
    after, _ = chase.drive(tracker.step(before, chase.scene(6, chase.ids[1:2])))
    ray = expected - chase.positions[1]
    radius = np.hypot(*(truth - chase.positions[1]))
    assert after.mean[[0, 2]] == pytest.approx(chase.positions[1] + radius * ray / np.hypot(*ray), abs=1e-4)


@pytest.mark.thorough
def test_the_velocity_is_as_uncertain_as_the_two_fixes_it_comes_from() -> None:
    """Over many trials, the errors of the last step's estimate spread as its covariance says."""
    chase, tracker = Chase(PATH, PLACES, Range(sd=0.5, reach=1e4)), GreyTracking()
    errors = []
    for seed in range(120):
        chase.seed = seed
        belief = chase.follow(tracker, 2)
        errors.append(belief.mean - PATH[2])
    cov = np.array(errors).T @ np.array(errors) / len(errors)
    assert cov == pytest.approx(belief.cov, abs=0.25 * np.diag(belief.cov).max())
    assert np.diag(cov) == pytest.approx(np.diag(belief.cov), rel=0.4)


def test_a_reading_is_a_packet_of_11_bytes_and_a_handover_one_of_33() -> None:
    chase, tracker = Chase(PATH, PLACES), GreyTracking()
    belief = chase.follow(tracker, 4)
    scene = chase.scene(5)
    _, asks = asked(tracker.step(belief, scene))
    parcels = [asks[0].parcel_of(member) for member in chase.members.values()]
    assert [(item.packets, item.packet_bits, item.what) for item in parcels] == [(1, 88, "reading")] * 5
    assert all(item.payload is member.reading for item, member in zip(parcels, chase.members.values(), strict=True))
    chase.members[101].reading = None
    assert asks[0].parcel_of(chase.members[101]) is None
    _, (send,) = asked(tracker.hand_over(belief, scene, 7), np.array([True]))
    assert isinstance(send, Send) and (send.to, send.parcel.packets, send.parcel.packet_bits) == (7, 1, 264)
    after, _ = chase.drive(tracker.hand_over(belief, scene, 7))
    assert after.head == 7 and after.points == belief.points
    assert chase.drive(tracker.hand_over(belief, scene, 7), silent)[0] is None
    assert tracker.belief_bits(belief) == 160 and GreyTracking(window=8).belief_bits(belief) == 256


def test_a_step_costs_its_fix_and_from_four_fixes_on_two_models() -> None:
    chase = Chase(PATH, PLACES)
    for correction, model in (("none", 20 * 4 + 69), ("tail", 20 * 4 + 69 + 43 * 4 + 112)):
        tracker = GreyTracking(correction=correction)
        for fixes, models in ((3, 0.0), (4, 2.0)):
            belief = chase.follow(tracker, fixes - 2)
            _, heard = chase.drive(tracker.step(belief, chase.scene(fixes - 1)))
            spent = heard.cycles[chase.head] - models * model
            assert spent in [fix_cycles(5, iterations) for iterations in range(1, 31)]
        assert grey_cycles(4, correction) == model
    belief = chase.follow(GreyTracking(predictor="linear"), 5)
    _, asks = asked(GreyTracking(predictor="linear").step(belief, chase.scene(6)))
    assert [ask.cycles for ask in asks if isinstance(ask, Compute)] == [2 * line_cycles(5)] == [2 * 48.0]
    _, asks = asked(GreyTracking().step(chase.follow(GreyTracking(), 5), chase.scene(6)))
    assert [ask.cycles for ask in asks if isinstance(ask, Compute)] == [2 * grey_cycles(5, "tail")], "no readings"


def test_it_needs_ranges_and_a_plane() -> None:
    tracker = GreyTracking()
    assert all(hasattr(Range, need) and hasattr(Rssi, need) for need in tracker.needs)
    assert list(tracker.check(SimpleNamespace(filter_motions=(ConstantVelocity(),)))) == []
    (issue,) = tracker.check(SimpleNamespace(filter_motions=(ConstantVelocity(), ConstantAcceleration())))
    assert issue.path == ("tracker", "kind") and "two columns" in issue.message


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", [Range(), Range(sd=50.0), Rssi(), Rssi(sd=30.0)])
@pytest.mark.parametrize(
    "tracker", [GreyTracking(), GreyTracking(window=4, shift=0.0, report="prediction", predictor="linear")]
)
def test_the_rules_of_the_seam_are_kept(tracker, sensor) -> None:
    check_tracker(tracker, sensor=sensor)
