"""Least-squares fixes from ranges."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares

from wsnsim.models.ranging import Range, Rssi
from wsnsim.trackers.shared.fixes import ITERATIONS, Ranged, fix_covariance, fix_cycles, fixed, least_squares, usable
from wsnsim.trackers.shared.readings import Evidence

RANGE = SimpleNamespace(sensor=Range(sd=2.0, reach=40.0))


def residuals(point, positions, ranges):
    return np.hypot(*(positions - point).T) - ranges


def ranged(positions, ranges, readings=None) -> Ranged:
    positions, ranges = np.array(positions, dtype=float), np.array(ranges, dtype=float)
    seen = Evidence(
        tuple(range(len(ranges))), ranges if readings is None else readings, positions, np.empty((len(ranges), 0))
    )
    return Ranged(seen, ranges)


@pytest.mark.parametrize("count", [3, 4, 8, 20])
def test_three_and_more_ranges_have_the_minimum_that_scipy_finds(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(40):
        target = rng.uniform(-200.0, 200.0, 2)
        positions = target + rng.uniform(-40.0, 40.0, (count, 2))
        ranges = np.maximum(residuals(target, positions, 0.0) + rng.normal(0.0, 2.0, count), 0.0)
        start = target + rng.normal(0.0, 5.0, 2)
        point, iterations = least_squares(positions, ranges, start)
        theirs = scipy_least_squares(residuals, point, args=(positions, ranges), xtol=1e-12, ftol=1e-12, gtol=1e-12)
        cost, at_start = ((residuals(place, positions, ranges) ** 2).sum() for place in (point, start))
        assert point == pytest.approx(theirs.x, abs=0.1), "a minimum: SciPy stays there"
        assert cost <= at_start and cost == pytest.approx(2.0 * theirs.cost, rel=1e-3, abs=1e-9)
        assert 1 <= iterations <= ITERATIONS


def test_exact_ranges_have_the_exact_point_from_far_away() -> None:
    positions = np.array([[0.0, 0.0], [50.0, 5.0], [20.0, 60.0], [-30.0, 25.0]])
    target = np.array([12.0, 17.0])
    point, _ = least_squares(positions, residuals(target, positions, 0.0), np.array([300.0, -200.0]))
    assert point == pytest.approx(target, abs=1e-6)


@pytest.mark.parametrize("bearing", np.linspace(0.0, 6.0, 7))
def test_one_range_has_the_point_of_its_circle_nearest_to_the_start(bearing: float) -> None:
    ray = np.array([math.cos(bearing), math.sin(bearing)])
    node = np.array([[3.0, -4.0]])
    for away in (0.1, 10.0, 200.0):
        point, iterations = least_squares(node, np.array([10.0]), node[0] + away * ray)
        assert point == pytest.approx(node[0] + 10.0 * ray) and iterations == 1


def test_two_ranges_have_the_nearer_crossing() -> None:
    """Circles of 5 about (0, 0) and (6, 0) cross at (3, 4) and (3, -4)."""
    positions, ranges = np.array([[0.0, 0.0], [6.0, 0.0]]), np.array([5.0, 5.0])
    assert least_squares(positions, ranges, np.array([40.0, 0.1]))[0] == pytest.approx([3.0, 4.0])
    assert least_squares(positions, ranges, np.array([-9.0, -0.1]))[0] == pytest.approx([3.0, -4.0])


@pytest.mark.parametrize(
    ("first", "second", "x"),
    [
        (2.0, 4.0, 2.0),  # they touch
        (1.0, 2.0, 2.5),  # a gap from 1 to 4
        (10.0, 2.0, 9.0),  # the second in the first: a gap from 8 to 10
        (2.0, 10.0, -3.0),  # the first in the second: a gap from -4 to -2
        (0.0, 0.0, 3.0),
    ],
)
def test_two_circles_that_do_not_meet_have_the_point_midway_which_is_a_least_square(first, second, x) -> None:
    positions, ranges = np.array([[0.0, 0.0], [6.0, 0.0]]), np.array([first, second])
    point, _ = least_squares(positions, ranges, np.array([1.0, 5.0]))
    assert point == pytest.approx([x, 0.0], abs=1e-9)
    theirs = scipy_least_squares(residuals, [x + 0.5, 0.7], args=(positions, ranges))
    assert (residuals(point, positions, ranges) ** 2).sum() <= 2.0 * theirs.cost + 1e-9


def test_where_solutions_are_equally_near_it_is_their_middle() -> None:
    assert least_squares(np.array([[3.0, 4.0]]), np.array([7.0]), np.array([3.0, 4.0]))[0] == pytest.approx([3.0, 4.0])
    positions = np.array([[0.0, 0.0], [6.0, 0.0]])
    assert least_squares(positions, np.array([5.0, 5.0]), np.array([3.0, 0.0]))[0] == pytest.approx([3.0, 0.0])


def test_nodes_in_one_place_are_one_and_no_node_leaves_the_start() -> None:
    twice = np.array([[0.0, 0.0], [0.0, 0.0], [6.0, 0.0]])
    assert least_squares(twice, np.array([4.0, 6.0, 5.0]), np.array([3.0, 9.0]))[0] == pytest.approx([3.0, 4.0])
    point, iterations = least_squares(np.empty((0, 2)), np.empty(0), np.array([1.0, 2.0]))
    assert point.tolist() == [1.0, 2.0] and iterations == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_nodes_in_a_line_leave_two_sides_and_the_start_chooses(side: float) -> None:
    along, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    positions = np.array([-30.0, 0.0, 10.0, 25.0])[:, None] * along
    target = 4.0 * along + side * 12.0 * across
    point, _ = least_squares(positions, residuals(target, positions, 0.0), target + side * 5.0 * across)
    assert point == pytest.approx(target, abs=1e-5)


def test_a_start_on_the_line_of_the_nodes_is_left() -> None:
    positions = np.array([[-20.0, 0.0], [0.0, 0.0], [20.0, 0.0]])
    target = np.array([3.0, 15.0])
    point, _ = least_squares(positions, residuals(target, positions, 0.0), np.zeros(2))
    assert np.abs(point) == pytest.approx(target, abs=1e-5)


def test_hostile_numbers_give_numbers() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        count = int(rng.integers(1, 6))
        positions = np.round(rng.uniform(-2.0, 2.0, (count, 2))) * 10.0 ** rng.integers(-3, 7)
        ranges = rng.choice([0.0, 1e-9, 1.0, 40.0, 9e8], count)
        point, iterations = least_squares(positions, ranges, positions[0])
        assert np.isfinite(point).all() and iterations <= ITERATIONS


@pytest.mark.parametrize(
    ("sensor", "count"), [(Range(sd=0.5), 3), (Range(sd=0.5), 6), (Rssi(sd=0.3), 4), (Rssi(sd=0.3), 2)]
)
def test_the_covariance_is_that_of_many_trials(sensor, count: int) -> None:
    rng = np.random.default_rng(5)
    target, trials = np.array([5.0, -3.0]), 600
    angles = np.array([0.3, 1.9, 4.4, 5.2, 2.8, 3.6])[:count]
    positions = (
        target + (np.array([30.0, 12.0, 20.0, 35.0, 8.0, 25.0])[:count] * np.array([np.cos(angles), np.sin(angles)])).T
    )
    exact = sensor.measure(np.tile(target, (count, 1)), positions, np.empty((count, 0)), np.zeros(count))
    found = []
    for _ in range(trials):
        readings = exact + sensor.sd * rng.normal(size=count)
        found.append(least_squares(positions, sensor.ranges(readings), target)[0])
    scene = SimpleNamespace(sensor=sensor)
    cov = fix_covariance(target, ranged(positions, sensor.ranges(exact), exact), 1e6, scene)
    assert np.cov(np.array(found).T) == pytest.approx(cov, abs=0.18 * np.trace(cov)), "three standard errors, and bias"


def test_what_is_left_open_is_as_uncertain_as_the_start() -> None:
    fix = fixed(ranged([[0.0, 0.0]], [10.0]), np.array([20.0, 0.0]), 6.0, RANGE)
    assert fix.point == pytest.approx([10.0, 0.0]) and fix.cov == pytest.approx(np.diag([4.0, 36.0]))
    fix = fixed(ranged([[0.0, 0.0]], [10.0]), np.zeros(2), 6.0, RANGE)  # at the node: no direction at all
    assert fix.cov == pytest.approx(36.0 * np.eye(2))
    crossed = fixed(ranged([[0.0, 0.0], [10.0, 10.0]], [10.0, 10.0]), np.array([9.0, 1.0]), 6.0, RANGE)
    assert crossed.point == pytest.approx([10.0, 0.0]) and crossed.cov == pytest.approx(4.0 * np.eye(2))


def test_distances_that_are_none_are_left_out() -> None:
    sensor = SimpleNamespace(ranges=lambda readings: np.array([math.nan, math.inf, -1.0, 2e9, 7.0]))
    kept = usable(ranged(np.arange(10.0).reshape(5, 2), np.zeros(5)).seen, SimpleNamespace(sensor=sensor))
    assert kept.ranges.tolist() == [7.0] and kept.seen.ids == (4,) and kept.seen.positions.tolist() == [[8.0, 9.0]]


class Counted(float):
    """A number that counts what is done with it, weighted."""

    spent = 0.0

    def _as(self, weight, value):
        Counted.spent += weight
        return Counted(value)

    def __add__(self, other):
        return self._as(1, float(self) + float(other))

    def __sub__(self, other):
        return self._as(1, float(self) - float(other))

    def __rsub__(self, other):
        return self._as(1, float(other) - float(self))

    def __mul__(self, other):
        return self._as(1, float(self) * float(other))

    def __truediv__(self, other):
        return self._as(3, float(self) / float(other))

    __radd__, __rmul__ = __add__, __mul__


def test_an_iteration_costs_what_its_operations_weigh() -> None:
    """Written out with numbers that count: residual, gradient, equations and trial of a range; and their solution."""
    dx, dy, x, radius, h, g = (Counted(value) for value in (3.0, 4.0, 1.0, 2.0, 0.5, 0.2))

    def root(value):
        Counted.spent += 4
        return Counted(math.sqrt(value))

    Counted.spent = 0.0
    ex, ey = x - dx, x - dy
    away = root(ex * ex + ey * ey)
    jx, jy, off = ex / away, ey / away, away - radius
    for total, product in ((h, (jx, jx)), (h, (jx, jy)), (h, (jy, jy)), (g, (jx, off)), (g, (jy, off))):
        total + product[0] * product[1]
    assert Counted.spent == 26.0
    Counted.spent = 0.0
    tx, ty = x - dx, x - dy
    miss = root(tx * tx + ty * ty) - radius
    g + miss * miss
    assert Counted.spent == 12.0
    Counted.spent = 0.0
    axx, ayy = h + g, h + g
    determinant = axx * ayy - h * h
    step_x, step_y = (h * g - ayy * g) / determinant, (h * g - axx * g) / determinant
    x + step_x, x + step_y
    root(step_x * step_x + step_y * step_y)
    g * 0.1
    assert Counted.spent == 27.0
    assert fix_cycles(5, 4) == 5 * 12 + 4 * (5 * (26 + 12) + 27)
    assert fix_cycles(0, 0) == 0.0 and fix_cycles(1, 1) < fix_cycles(2, 1) < fix_cycles(3, 1)
