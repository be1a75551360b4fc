"""Trilateration: exact circles, circles that touch or miss each other, and what becomes of the rest of the state."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearMotion, LinearSensor, sent
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.testing import check_tracker
from wsnsim.trackers.trilateration import Trilateration, weighted_centroid

ROOM = np.array([[0.0, 5.0], [5.0, 10.0], [10.0, 0.0]])
"""The anchors of the paper's simulation."""
AWAY = np.array([1e3, -1e3])
"""An expectation that helps nobody."""


def circles(centres: list[tuple[float, float]], radii: list[float]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(centres, dtype=float).reshape(-1, 2), np.array(radii, dtype=float)


def located_twin(given: tuple[np.ndarray, np.ndarray], expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pair after pair, with angles in place of chords. Circles that meet only."""
    points, weights = [], []
    for i, j in combinations(range(len(given[1])), 2):
        (a, b), (r, s) = given[0][[i, j]], given[1][[i, j]]
        apart, bearing = np.hypot(*(b - a)), np.arctan2(*(b - a)[::-1])
        half = np.arccos((r**2 + apart**2 - s**2) / (2.0 * r * apart))
        both = [a + r * np.array([np.cos(bearing + turn), np.sin(bearing + turn)]) for turn in (half, -half)]
        misfits = [
            sum(abs(np.hypot(*(point - c)) - d) for c, d in zip(given[0], given[1], strict=True)) for point in both
        ]
        if abs(misfits[0] - misfits[1]) < 1e-7:
            misfits = [np.hypot(*(point - expected)) for point in both]
        points.append(both[int(misfits[1] < misfits[0])])
        weights.append(1.0 / (r + s))
    points = np.array(points)
    return np.average(points, axis=0, weights=weights), np.cov(points.T, aweights=weights, ddof=0).reshape(2, 2)


@pytest.mark.parametrize("count", [3, 4, 7])
def test_exact_distances_give_the_exact_point(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(50):
        centres, target = rng.uniform(-50.0, 50.0, (count, 2)), rng.uniform(-50.0, 50.0, 2)
        found, spread = weighted_centroid(*(centres, np.hypot(*(centres - target).T)), AWAY)
        assert found == pytest.approx(target, abs=1e-4), "a root of rounding, where a target is between two nodes"
        assert np.abs(spread).max() < 1e-6


def test_circles_that_cross_are_those_of_the_twin() -> None:
    rng, crossing = np.random.default_rng(1), 0
    for _ in range(200):
        target = rng.uniform(2.0, 8.0, 2)
        given = (ROOM, np.hypot(*(ROOM - target).T) + rng.normal(0.0, 0.3, 3))
        apart = [np.hypot(*(ROOM[i] - ROOM[j])) for i, j in combinations(range(3), 2)]
        pairs = list(zip(combinations(given[1], 2), apart, strict=True))
        if all(abs(r - s) < far < r + s for (r, s), far in pairs):
            crossing += 1
            for found, expected in zip(weighted_centroid(*given, AWAY), located_twin(given, AWAY), strict=True):
                assert found == pytest.approx(expected, abs=1e-6)
    assert crossing > 100


def test_circles_that_miss_each_other_share_the_gap_by_their_radii_and_pairs_weigh_by_them() -> None:
    """Radii 1, 2, 3 at the corners of a right angle: points (10/3, 0), (0, 5/2), (6, 4), weights 1/3, 1/4, 1/5."""
    found, spread = weighted_centroid(*circles([(0, 0), (10, 0), (0, 10)], [1, 2, 3]), AWAY)
    total = 1 / 3 + 1 / 4 + 1 / 5
    x, y = (10 / 9 + 6 / 5) / total, (5 / 8 + 4 / 5) / total
    assert found == pytest.approx([x, y])
    across = (100 / 27 + 36 / 5) / total - x * x
    assert spread[0, 0] == pytest.approx(across) and spread[0, 1] == pytest.approx(24 / 5 / total - x * y)


@pytest.mark.parametrize(
    ("first", "second", "point"),
    [
        (2.0, 4.0, 2.0),  # they touch from outside
        (1.0, 2.0, 2.0),  # a gap of 3 from 1 to 4, shared 1 to 2
        (8.0, 2.0, 8.0),  # the second touches the first from within
        (10.0, 2.0, 10.0 - 2.0 * 10.0 / 12.0),  # the second lies in the first: a gap of 2 beyond it, from 8 to 10
        (2.0, 10.0, -2.0 - 2.0 * 2.0 / 12.0),  # the first lies in the second: a gap of 2 behind it, from -4 to -2
        (0.0, 3.0, 0.0),  # a distance of nothing at one of them
        (0.0, 0.0, 0.0),
    ],
)
def test_two_circles_that_touch_or_miss_give_a_point_on_their_line(first: float, second: float, point: float) -> None:
    found, spread = weighted_centroid(*circles([(0, 0), (6, 0)], [first, second]), AWAY)
    assert found == pytest.approx([point, 0.0], abs=1e-9)
    assert np.abs(spread).max() < 1e-12


@pytest.mark.parametrize("gap", [-1e-9, 1e-9])
def test_where_circles_just_touch_the_point_does_not_jump(gap: float) -> None:
    for radii in ([2.0, 4.0 + gap], [8.0 + gap, 2.0]):
        found, _ = weighted_centroid(*circles([(0, 0), (6, 0)], radii), AWAY)
        assert found == pytest.approx([radii[0], 0.0], abs=2e-4), "a crossing is a root of the overlap aside"


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_nodes_in_a_line_cannot_tell_a_side_and_the_expectation_does(side: float, count: int) -> None:
    centres = np.array([[3.0 * i, 2.0 * i + 1.0] for i in range(count)])
    normal = np.array([-2.0, 3.0]) / np.sqrt(13.0)
    target = centres[0] + 1.3 * (centres[1] - centres[0]) + side * 4.0 * normal
    radii = np.hypot(*(centres - target).T)
    found, _ = weighted_centroid(*(centres, radii), target + 2.0)
    assert found == pytest.approx(target, abs=1e-6)
    mirror = target - 2.0 * side * 4.0 * normal
    found, _ = weighted_centroid(*(centres, radii), mirror + 1.0)
    assert found == pytest.approx(mirror, abs=1e-6)


def test_a_third_circle_decides_against_the_expectation() -> None:
    target = np.array([6.0, 3.0])
    found, _ = weighted_centroid(*(ROOM, np.hypot(*(ROOM - target).T)), np.array([-50.0, 80.0]))
    assert found == pytest.approx(target, abs=1e-6)


@pytest.mark.parametrize("given", [circles([], []), circles([(1, 1)], [2]), circles([(1, 1), (1, 1)], [2, 3])])
def test_without_a_pair_there_is_no_point(given: tuple[np.ndarray, np.ndarray]) -> None:
    assert weighted_centroid(*given, AWAY) is None


def test_nodes_in_the_same_place_are_no_pair_but_each_is_one_with_a_third() -> None:
    found, _ = weighted_centroid(*circles([(0, 0), (0, 0), (6, 0)], [2, 2, 4]), AWAY)
    assert found == pytest.approx([2.0, 0.0], abs=1e-6)


class Distances(LinearSensor):
    """The distance itself; no likelihoods."""

    def measure(self, points, positions, traits, noise):
        return np.hypot(*(points - positions).T)

    def ranges(self, readings):
        return readings


def test_the_position_is_measured_and_the_rest_is_the_motions_prediction() -> None:
    cluster, tracker, motion = Cluster(5, sensor=Distances()), Trilateration(floor=0.25), LinearMotion()
    before, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert heard.packets == []
    belief, heard = cluster.drive(tracker.step(before, cluster.scene(1)))
    assert sent(heard, cluster.head) == {"^reading": 4}
    assert heard.cycles == {cluster.head: 40 + 10 * (40 + 2 * 10 * 5)}
    assert belief.mean[[0, 2]] == pytest.approx(cluster.truth[1][[0, 2]], abs=1e-4)
    assert belief.cov[np.ix_([0, 2], [0, 2])] == pytest.approx(0.25**2 * np.eye(2), abs=1e-6)
    transition = motion.matrices(np.zeros((4, 1)), 1.0)[0][0]
    predicted = transition @ before.cov @ transition.T + motion.noise
    assert belief.mean[[1, 3]] == pytest.approx((transition @ before.mean)[[1, 3]])
    assert belief.cov[np.ix_([1, 3], [1, 3])] == pytest.approx(predicted[np.ix_([1, 3], [1, 3])])
    assert not belief.cov[np.ix_([0, 2], [1, 3])].any() and np.array_equal(belief.cov, belief.cov.T)


@pytest.mark.parametrize("known", [0, 1])
def test_with_fewer_than_two_distances_the_belief_is_predicted(known: int) -> None:
    cluster, tracker, motion = Cluster(5, sensor=Distances()), Trilateration(), LinearMotion()
    before, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    after, _ = cluster.drive(tracker.step(before, cluster.scene(2, cluster.ids[:known], steps=2)))
    assert after.mean == pytest.approx(motion.advance(motion.advance(before.mean[:, None], 1.0), 1.0)[:, 0])
    assert np.all(np.diag(after.cov) > np.diag(before.cov)) and after.head == cluster.head


class Broken(Distances):
    """Distances that are none, at some nodes."""

    def ranges(self, readings):
        return np.where(np.arange(readings.size) < 3, [np.nan, np.inf, -1.0, 0.0, 0.0][: readings.size], readings)


def test_a_distance_that_is_none_is_left_out() -> None:
    cluster, tracker = Cluster(5, sensor=Broken()), Trilateration()
    before, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    belief, _ = cluster.drive(tracker.step(before, cluster.scene(1)))
    truth = cluster.truth[1][[0, 2]]
    rest = (cluster.positions[3:], np.hypot(*(cluster.positions[3:] - truth).T))
    expected = LinearMotion().advance(before.mean[:, None], 1.0)[[0, 2], 0]
    assert belief.mean[[0, 2]] == pytest.approx(weighted_centroid(*rest, expected)[0])


def test_it_needs_ranges_and_a_plane() -> None:
    tracker = Trilateration()
    assert all(hasattr(Range, need) and hasattr(Rssi, need) for need in tracker.needs)
    assert list(tracker.check(SimpleNamespace(filter_motions=(ConstantVelocity(),)))) == []
    (issue,) = tracker.check(SimpleNamespace(filter_motions=(ConstantAcceleration(),)))
    assert issue.path == ("tracker", "kind") and "two columns" in issue.message


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", [Range(), Range(sd=50.0), Rssi(), Rssi(sd=30.0)])
def test_the_rules_of_the_seam_are_kept(sensor) -> None:
    check_tracker(Trilateration(), sensor=sensor)
