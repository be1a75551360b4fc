"""Least-squares position fixes from ranges, and the base of trackers that compute one at each step.

least_squares(positions (S, 2), ranges (S,), start (2,)) -> (fix (2,), iterations)

Operations are weighted as in Li (2012)'s figures: add and multiply 1, divide 3, square root 4, exponential, logarithm
and angle 20; comparisons are free. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Parcel, Send
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.heads import HeadFilter
from wsnsim.trackers.shared.moments import forecast, predicted, symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings, ranges_of

ITERATIONS: Final = 30
"""Maximum number of iterations (our choice); most fixes take five or six."""
ENOUGH: Final = 1e-6
"""A step (m) shorter than this ends the iteration (our choice)."""
DAMPING: Final = 1e-3
"""Damping at the start (our choice)."""
LEAST_DAMPING: Final = 1e-9
"""Least damping (our choice): without any, the equations of nodes in a line are singular."""
ASIDE: Final = 1e-6 * math.cos(1.0), 1e-6 * math.sin(1.0)
"""Of the mean range: what the descent starts beside its start. On a line of nodes there is no slope across it."""
EQUALLY_NEAR: Final = 1e-9
"""Two solutions are equally near the start if their distances from it differ by less than this share (our choice)."""
OPEN: Final = 0.01
"""Of the sum of both: an axis with a smaller share is left open by the ranges: nodes within 11 degrees (our choice)."""
FARTHEST: Final = 1e9
"""Longer ranges (m) are ignored (our choice)."""

Circle = tuple[float, float, float]
Point = tuple[float, float]


class Ranged(NamedTuple):
    """Usable measurements, and the distances (S,) in m that they stand for."""

    seen: Evidence
    ranges: Floats


class Fix(NamedTuple):
    """A position (2,) in m, its covariance (2, 2), and the number of iterations."""

    point: Floats
    cov: Floats
    iterations: int


def usable(seen: Evidence, scene: Scene) -> Ranged:
    """The measurements whose distances are neither negative nor NaN, and below `FARTHEST`."""
    ranges = ranges_of(seen, scene.sensor)
    known = (ranges >= 0.0) & (ranges < FARTHEST)
    if known.all():
        return Ranged(seen, ranges)
    return Ranged(seen.part(known), ranges[known])


def fixed(ranged: Ranged, start: Floats, spread: float, scene: Scene) -> Fix:
    """The target's position from S >= 1 ranges near a start; what they leave open is as uncertain as `spread` m."""
    point, iterations = least_squares(ranged.seen.positions, ranged.ranges, start)
    return Fix(point, fix_covariance(point, ranged, spread, scene), iterations)


def fix_covariance(point: Floats, ranged: Ranged, spread: float, scene: Scene) -> Floats:
    """(2, 2) of a least-squares fix, to the first order: H⁻¹ (Σ v u uᵀ) H⁻¹, H = Σ u uᵀ.

    u points from a node to the fix; v is the variance of its range: that of the reading over the squared slope of the
    sensor's law. An axis of H that is next to nothing has the variance `spread`² (our choice).
    """
    _, slopes, variances = scene.sensor.linearise(point[:, None], ranged.seen.positions, ranged.seen.traits)
    steep = np.hypot(slopes[:, 0, 0], slopes[:, 1, 0])
    telling = steep > 0.0  # at the node itself a range has no direction
    u = slopes[telling, :, 0] / steep[telling, None]
    v = variances[telling, 0] / steep[telling] ** 2
    values, axes = np.linalg.eigh(u.T @ u)
    determined = values > OPEN * max(float(values.sum()), OPEN)
    inverse = (axes[:, determined] / values[determined]) @ axes[:, determined].T
    unknown = axes[:, ~determined]
    return symmetric(inverse @ (u.T @ (v[:, None] * u)) @ inverse + spread**2 * (unknown @ unknown.T))


def fix_cycles(ranges: int, iterations: int) -> float:
    """Operations of a fix. The covariance is not included: only the filter of Cluster needs it.

    One range: 19, a direction and a point on it. Two: 60, their crossings and which is nearer. More: the first cost, 12
    a range; then in each iteration and range residual, gradient and normal equations (26), and the cost of the trial
    (12), and in each iteration 27 to solve two equations, to step, and to damp.
    """
    if ranges < 3:
        return (0.0, 19.0, 60.0)[ranges]
    return 12.0 * ranges + iterations * (38.0 * ranges + 27.0)


def least_squares(positions: Floats, ranges: Floats, start: Floats) -> tuple[Floats, int]:
    """The point (2,) near a start that fits the ranges best, by damped Gauss-Newton steps; and how many they were.

    Nodes in one place: the point of their circle nearest to the start. Nodes in two: of the crossings the nearer; if
    they do not meet, the point midway between them. Where solutions are equally near, their middle. None: the start.
    """
    circles = [(x, y, r) for (x, y), r in zip(positions.tolist(), ranges.tolist(), strict=True)]
    x, y = float(start[0]), float(start[1])
    merged = _merged(circles)
    if len(merged) > 2:
        return _descend(circles, x, y)
    if not merged:
        return np.array([x, y]), 0
    return np.array(_on_circle(merged[0], x, y) if len(merged) == 1 else _crossing(merged[0], merged[1], x, y)), 1


def _merged(circles: Sequence[Circle]) -> list[Circle]:
    """One circle about each place, of the mean radius where several nodes stand in one."""
    found: dict[Point, list[float]] = {}
    for x, y, radius in circles:
        found.setdefault((x, y), []).append(radius)
    return [(x, y, sum(radii) / len(radii)) for (x, y), radii in found.items()]


def _on_circle(circle: Circle, x: float, y: float) -> Point:
    cx, cy, radius = circle
    away = math.hypot(x - cx, y - cy)
    if away <= EQUALLY_NEAR * radius:
        return cx, cy
    return cx + (x - cx) * radius / away, cy + (y - cy) * radius / away


def _crossing(one: Circle, other: Circle, x: float, y: float) -> Point:
    """The least squares of two ranges that is nearer to (x, y)."""
    (ax, ay, a), (bx, by, b) = one, other
    apart = math.hypot(bx - ax, by - ay)
    ex, ey = (bx - ax) / apart, (by - ay) / apart
    if apart >= a + b:
        along, aside = (apart + a - b) / 2.0, 0.0
    elif apart <= abs(a - b):  # one in the other: beyond the smaller, on the line of both
        along, aside = ((a + apart + b) / 2.0 if a > b else (apart - a - b) / 2.0), 0.0
    else:
        along = (apart + (a - b) * (a + b) / apart) / 2.0
        aside = math.sqrt(max((a - along) * (a + along), 0.0))
    left, right = ((ax + along * ex - side * ey, ay + along * ey + side * ex) for side in (aside, -aside))
    to_left, to_right = (math.hypot(px - x, py - y) for px, py in (left, right))
    if abs(to_left - to_right) <= EQUALLY_NEAR * (to_left + to_right):
        return (left[0] + right[0]) / 2.0, (left[1] + right[1]) / 2.0
    return left if to_left < to_right else right


def _descend(circles: Sequence[Circle], x: float, y: float) -> tuple[Floats, int]:
    """Levenberg's and Marquardt's way down the sum of squared residuals. Marquardt (1963)."""
    scale = sum(radius for _, _, radius in circles) / len(circles)
    x, y = x + scale * ASIDE[0], y + scale * ASIDE[1]
    damping, cost = DAMPING, _cost(circles, x, y)
    for iteration in range(1, ITERATIONS + 1):
        hxx = hxy = hyy = gx = gy = 0.0
        for cx, cy, radius in circles:
            dx, dy = x - cx, y - cy
            away = math.hypot(dx, dy) or ENOUGH
            jx, jy, residual = dx / away, dy / away, away - radius
            hxx, hxy, hyy = hxx + jx * jx, hxy + jx * jy, hyy + jy * jy
            gx, gy = gx + jx * residual, gy + jy * residual
        axx, ayy = hxx + damping, hyy + damping
        determinant = axx * ayy - hxy * hxy
        step_x, step_y = (hxy * gy - ayy * gx) / determinant, (hxy * gx - axx * gy) / determinant
        trial = _cost(circles, x + step_x, y + step_y)
        if trial <= cost:
            x, y, cost, damping = x + step_x, y + step_y, trial, max(0.1 * damping, LEAST_DAMPING)
        else:
            damping *= 10.0
        if math.hypot(step_x, step_y) < ENOUGH:
            return np.array([x, y]), iteration
    return np.array([x, y]), ITERATIONS


def _cost(circles: Sequence[Circle], x: float, y: float) -> float:
    hypot = math.hypot
    return sum([(hypot(x - cx, y - cy) - radius) ** 2 for cx, cy, radius in circles])


@dataclass(frozen=True, slots=True)
class Fixes:
    """The last fixes: `times` (n,) in s and `points`, oldest first; and the moments of the whole state now.

    `last_cov` (2, 2) is of the last fix. `unknown` (D,): variances of what ranges do not tell, from the prior.
    `foretold`: what had been predicted for the last step, None if nothing was.
    """

    times: tuple[float, ...]
    points: tuple[Point, ...]
    mean: Floats
    cov: Floats
    head: int
    last_cov: Floats
    unknown: Floats
    foretold: Estimate | None = None
    effective: float = float("nan")


class OfRanges(HeadFilter):
    """The base of filters that take distances, one from each reading."""

    needs: ClassVar[tuple[str, ...]] = ("ranges",)
    """Methods that its sensor must have in addition to the port's."""
    angles: ClassVar[bool] = False
    vector_readings: ClassVar[bool] = False
    relative_readings: ClassVar[bool] = False

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """The position of the motion model must have two columns."""
        if any(len(motion.position) != 2 for motion in setup.filter_motions):
            yield Issue(
                ("tracker", "kind"),
                "a position from ranges needs a motion model whose position has two columns, such as "
                "constant_velocity or bounded_velocity",
            )


@part
class RangeFix(OfRanges):
    """Base of trackers that compute a fix at each step by least squares on the ranges that arrived.

    A subclass defines the expected position (`_at`), the start of the search (`_start_of`), the number of fixes that it
    keeps, the bits of a handover, and its operations other than the fix. Columns of the state other
    than the position are the velocity, from the last two fixes, if they are named vx and vy, and else unknown: 0 with
    the prior's spread. The position that a track starts with counts as its first fix (our choice).
    """

    window: ClassVar[int]
    """Number of fixes that are kept."""

    reading_bits: Annotated[int, Quantity("", ge=1, le=100_000, label="bit"), "bits of a reading on the air"] = 88

    def start(self, prior: Estimate, scene: Scene) -> Flow[Fixes]:
        """The prior, whose position is the first fix."""
        place = _both(*scene.motion.position)
        x, y = prior.mean[place].tolist()
        unknown = np.diag(prior.cov) + prior.mean**2
        return Fixes(
            (scene.time,), ((x, y),), prior.mean, prior.cov, scene.head, prior.cov[place, place].copy(), unknown
        )
        yield  # a flow without requests

    def step(self, belief: Fixes, scene: Scene) -> Flow[Fixes]:
        """One step: N_act - 1 measurements reach the head, which computes a fix; without any, it predicts."""
        ranged = usable((yield from gather_readings(scene, self.reading_bits)), scene)
        expected = self._placed(Estimate(*predicted(belief.mean, belief.cov, scene)), belief, scene.time, scene)
        count = ranged.ranges.size
        if not count:
            yield Compute(self._other_cycles(len(belief.points)))
            foretold = expected if self._predicts(belief) else None
            return replace(belief, mean=expected.mean, cov=expected.cov, head=scene.head, foretold=foretold)
        fix = fixed(ranged, *self._start_of(expected, ranged, scene), scene)
        fixes = min(len(belief.points) + 1, self.window)
        yield Compute(fix_cycles(count, fix.iterations) + self._other_cycles(fixes))
        return self._with(belief, fix, expected, scene)

    def hand_over(self, belief: Fixes, scene: Scene, successor: int) -> Flow[Fixes | None]:
        """One packet with the fixes, or nothing. The moments of the state follow from the fixes and the models."""
        payload = belief.times, belief.points, belief.last_cov
        mask = yield Send(successor, Parcel(payload, 1, self._handover_bits, "handover"))
        return replace(belief, head=successor) if mask.all() else None

    def forecast(self, belief: Fixes, scene: Scene, ahead: int) -> Estimate:
        """The expected position `ahead` steps later, with the covariance of the motion model's prediction."""
        moved = forecast(Estimate(belief.mean, belief.cov), scene, ahead)
        return self._placed(moved, belief, scene.time + ahead * scene.dt, scene)

    @property
    def _handover_bits(self) -> int:
        raise NotImplementedError

    def _other_cycles(self, fixes: int) -> float:
        """Operations of a step other than the fix, given the number of kept fixes."""
        raise NotImplementedError

    def _predicts(self, belief: Fixes) -> bool:
        """Whether it predicts the position, instead of keeping the last one."""
        return False

    def _at(self, belief: Fixes, time: float, scene: Scene) -> Floats:
        """(2,) the expected position at a time: by default the last fix."""
        return np.array(belief.points[-1])

    def _start_of(self, expected: Estimate, ranged: Ranged, scene: Scene) -> tuple[Floats, float]:
        """(2,) from where the fix is searched, and how far in m the target is from there: as expected.

        No farther than the longest range says.
        """
        x, y = scene.motion.position
        off = math.sqrt(float(expected.cov[x, x] + expected.cov[y, y]))
        return expected.mean[_both(x, y)], min(off, float(ranged.ranges.max()))

    def _placed(self, moved: Estimate, belief: Fixes, time: float, scene: Scene) -> Estimate:
        """The motion model's prediction, moved to the expected position; the difference is added to the covariance."""
        place = _both(*scene.motion.position)
        mean, cov = moved.mean.copy(), moved.cov.copy()
        mean[place] = self._at(belief, time, scene)
        off = moved.mean[place] - mean[place]
        cov[place, place] += off[:, None] * off
        return Estimate(mean, cov)

    def _with(self, belief: Fixes, fix: Fix, expected: Estimate, scene: Scene) -> Fixes:
        """The belief with one more fix; of two at one time the later."""
        x, y = fix.point.tolist()
        earlier = [(time, point) for time, point in zip(belief.times, belief.points, strict=True) if time < scene.time]
        kept = [*earlier, (scene.time, (x, y))][-self.window :]
        times, points = tuple(time for time, _ in kept), tuple(point for _, point in kept)
        mean, cov = _state(times, points, (belief.last_cov, fix.cov), belief.unknown, scene)
        foretold = expected if self._predicts(belief) else None
        return Fixes(times, points, mean, cov, scene.head, fix.cov, belief.unknown, foretold)


def _both(first: int, second: int) -> slice:
    """The slice of two rows, in this order: a view, which an index by a list is not."""
    step = second - first
    stop = second + (1 if step > 0 else -1)
    return slice(first, stop if stop >= 0 else None, step)


def _state(
    times: tuple[float, ...], points: tuple[Point, ...], covs: tuple[Floats, Floats], unknown: Floats, scene: Scene
) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of the state that two independent fixes tell, `covs` their covariances."""
    columns, place = scene.motion.columns, _both(*scene.motion.position)
    mean, cov = np.zeros(len(columns)), np.diag(unknown)
    mean[place] = points[-1]
    cov[place, place] = covs[1]
    if len(times) > 1 and "vx" in columns and "vy" in columns:
        moving, passed = _both(columns.index("vx"), columns.index("vy")), times[-1] - times[-2]
        (x, y), (last_x, last_y) = points[-1], points[-2]
        mean[moving] = (x - last_x) / passed, (y - last_y) / passed
        cov[moving, moving] = (covs[0] + covs[1]) / passed**2
        cov[place, moving] = cov[moving, place] = covs[1] / passed
    return mean, cov
