"""Where a target is by least squares on ranges, and what trackers share that start from such a fix at each step.

least_squares(positions (S, 2), ranges (S,), start (2,)) -> (fix (2,), iterations)      RangeFix, a base of trackers
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, NamedTuple, Protocol, cast

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.asks import Compute, Flow, Gather, Member, Parcel, Send
from wsnsim.base.errors import Fault
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.problem import Problem
from wsnsim.trackers.shared.heads import HeadFilter
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence

ITERATIONS: Final = 30
ENOUGH: Final = 1e-6
"""m: a step that is shorter ends the iteration (our choice)."""
DAMPING: Final = 1e-3
FARTHEST: Final = 1e9
"""m: a longer range is none (our choice)."""
RANGE_CYCLES: Final = 38.0
"""Operations a range and iteration: residual, gradient, normal equations (26), and the cost of the trial (12). Weighted
as in Li (2012)'s page: add and multiply 1, divide 3, square root 4, exponential, logarithm, angle 20."""
SOLVE_CYCLES: Final = 20.0
"""Operations an iteration besides: two equations solved, a step tried."""

Circle = tuple[float, float, float]


class TellsRanges(Protocol):
    """What a sensor must be able to do."""

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected."""
        ...


class Fix(NamedTuple):
    """A position (2,) in m, its covariance (2, 2), and the operations it took."""

    point: Floats
    cov: Floats
    cycles: float


@dataclass(frozen=True, slots=True)
class Fixes:
    """The last fixes: `times` (n,) in s and `points` (n, 2), oldest first; with the moments of the whole state.

    `expected` (2,): what had been predicted for the last of them. `prior`: variances (D,) of what ranges do not tell.
    `place`: the columns of the position.
    """

    times: tuple[float, ...]
    points: tuple[tuple[float, float], ...]
    mean: Floats
    cov: Floats
    head: int
    expected: tuple[float, float]
    prior: Floats
    place: tuple[int, ...]
    effective: float = float("nan")


@part
class RangeFix(HeadFilter):
    """What trackers share that fix the target anew at each step, by least squares on the ranges that came.

    A tracker of this kind says from where the search starts (`_start_of`), how many fixes it keeps (`_kept`), what it
    makes of them later (`_at`), and what it computes for that (`_cycles`). Columns of the state other than the position
    are the velocity, from the last two fixes, if they are named vx and vy, and else unknown: 0 with the prior's spread.
    """

    needs: ClassVar[tuple[str, ...]] = ("ranges",)
    """What its sensor must be able to do besides."""

    reading_bits: Annotated[int, Quantity("", ge=1, le=100_000), "of a reading on the air"] = 88

    def start(self, prior: Estimate, scene: Scene) -> Flow[Fixes]:
        """The prior's position is the first fix."""
        x, y = prior.mean[list(scene.motion.position)].tolist()
        variances = np.diag(prior.cov).copy()
        place = scene.motion.position
        return Fixes((scene.time,), ((x, y),), prior.mean, prior.cov, scene.head, (x, y), variances, place)
        yield  # a flow that asks for nothing

    def step(self, belief: Fixes, scene: Scene) -> Flow[Fixes]:
        """One step: N_act - 1 readings reach the head, which fixes the target. Without any it goes on as predicted."""
        seen = yield from gather_ranges(scene, self.reading_bits)
        expected = self._at(belief, scene.time, scene)
        if not seen.ids:
            yield self._compute(0.0, len(belief.points))
            return self._coasting(belief, expected, scene)
        fix = fixed(seen, self._start_of(belief, expected, seen), scene)
        yield self._compute(fix.cycles, len(belief.points) + 1)
        return self._with(belief, fix, expected, scene)

    def hand_over(self, belief: Fixes, scene: Scene, successor: int) -> Flow[Fixes | None]:
        """One packet with the fixes, or nothing."""
        mask = yield Send(successor, Parcel(belief, 1, self._handover_bits, "fixes"))
        return replace(belief, head=successor) if mask.all() else None

    def forecast(self, belief: Fixes, scene: Scene, ahead: int) -> Estimate:
        """Where the target is expected at the instant of the step that is so many steps on."""
        place = list(scene.motion.position)
        mean, cov = belief.mean.copy(), belief.cov.copy()
        mean[place] = self._at(belief, (scene.step + ahead) * scene.dt, scene)
        cov[place, place] += scene.sensor.reach**2 if math.isfinite(scene.sensor.reach) else 0.0
        return Estimate(mean, cov)

    def faults(self, parts: Problem) -> Iterator[Fault]:
        """Circles cross in the plane."""
        if any(len(motion.position) != 2 for motion in parts.filter_motions):
            yield Fault(("tracker", "kind"), "it fixes a position in the plane; this motion is along a line")

    @property
    def _handover_bits(self) -> int:
        raise NotImplementedError

    @property
    def _kept(self) -> int:
        raise NotImplementedError

    def _at(self, belief: Fixes, time: float, scene: Scene) -> Floats:
        """(2,) where the target is expected at a time: where it was last, unless a tracker says otherwise."""
        return np.array(belief.points[-1])

    def _start_of(self, belief: Fixes, expected: Floats, seen: Evidence) -> Floats:
        """(2,) where the search for the fix starts: where the target is expected, unless a tracker says otherwise."""
        return expected

    def _compute(self, fixing: float, fixes: int) -> Compute:
        raise NotImplementedError

    def _with(self, belief: Fixes, fix: Fix, expected: Floats, scene: Scene) -> Fixes:
        """The belief with one more fix."""
        x, y = fix.point.tolist()
        fresh = [(time, point) for time, point in zip(belief.times, belief.points, strict=True) if time < scene.time]
        kept = [*fresh, (scene.time, (x, y))][-self._kept :]
        times, points = tuple(time for time, _ in kept), tuple(point for _, point in kept)
        mean, cov = _state(times, points, fix.cov, belief.prior, scene)
        guess = (float(expected[0]), float(expected[1]))
        return Fixes(times, points, mean, cov, scene.head, guess, belief.prior, belief.place)

    def _coasting(self, belief: Fixes, expected: Floats, scene: Scene) -> Fixes:
        """The belief without a new fix: the position as predicted, and less certain."""
        place = list(scene.motion.position)
        mean, cov = belief.mean.copy(), belief.cov.copy()
        mean[place] = expected
        cov[place, place] += (np.linalg.norm(expected - np.array(belief.points[-1])) + 1.0) ** 2
        guess = (float(expected[0]), float(expected[1]))
        return replace(belief, mean=mean, cov=cov, head=scene.head, expected=guess)


def gather_ranges(scene: Scene, bits: int) -> Flow[Evidence]:
    """The readings that reached the head, its own for nothing: a packet of so many bits a member."""

    def parcel_of(member: Member) -> Parcel | None:
        if member.reading is None or not math.isfinite(member.reading):
            return None
        return Parcel(member.reading, 1, bits, "reading")

    answer = yield Gather(parcel_of)
    rows = [row for row, node in enumerate(scene.ids) if node in answer]
    values = np.array([answer[scene.ids[row]][0] for row in rows], dtype=np.float64)
    return Evidence(tuple(scene.ids[row] for row in rows), values, scene.positions[rows], scene.traits[rows])


def fixed(seen: Evidence, start: Floats, scene: Scene) -> Fix:
    """The target's position from S >= 1 readings, with the inverse of Fisher's information there.

    What the readings leave open is as uncertain as the sensors' reach (our choice).
    """
    ranges = cast(TellsRanges, scene.sensor).ranges(seen.readings)
    known = (ranges >= 0.0) & (ranges < FARTHEST)
    point, iterations = least_squares(seen.positions[known], ranges[known], start)
    information = information_at(point, seen, scene)
    reach = scene.sensor.reach if math.isfinite(scene.sensor.reach) else FARTHEST
    cov: Floats = np.linalg.inv(information + np.eye(2) / reach**2).astype(np.float64)
    return Fix(point, symmetric(cov), fix_cycles(len(seen.ids), iterations))


def information_at(point: Floats, seen: Evidence, scene: Scene) -> Floats:
    """(2, 2) Σ g gᵀ / R of the readings about a position at a point."""
    _, gradients, variances = scene.sensor.linearise(point[:, None], seen.positions, seen.traits)
    g = gradients[:, :, 0]
    return g.T @ (g / variances[:, 0, None])


def fix_cycles(ranges: int, iterations: int) -> float:
    """Operations of a fix from so many ranges."""
    return iterations * (ranges * RANGE_CYCLES + SOLVE_CYCLES)


def least_squares(positions: Floats, ranges: Floats, start: Floats) -> tuple[Floats, int]:
    """The point (2,) that fits the ranges best near a start, by damped Gauss-Newton steps; and how many steps it took.

    One range: the point of the circle nearest to the start. Two: of their crossings the nearer; if they do not meet,
    the point between them. Nodes in one place count as one. None: the start.
    """
    circles = _circles(positions, ranges)
    if not circles:
        return np.array(start, dtype=np.float64), 0
    x, y = float(start[0]), float(start[1])
    if len(circles) == 1:
        return np.array(_on_circle(circles[0], x, y)), 1
    if len(circles) == 2:
        return np.array(_crossing(circles[0], circles[1], x, y)), 1
    return _descend(circles, x, y)


def _circles(positions: Floats, ranges: Floats) -> list[Circle]:
    """(x, y, r) about each place, the mean r where several nodes stand in one."""
    found: dict[tuple[float, float], list[float]] = {}
    for (x, y), radius in zip(positions.tolist(), ranges.tolist(), strict=True):
        found.setdefault((x, y), []).append(radius)
    return [(x, y, sum(radii) / len(radii)) for (x, y), radii in found.items()]


def _on_circle(circle: Circle, x: float, y: float) -> tuple[float, float]:
    cx, cy, radius = circle
    away = math.hypot(x - cx, y - cy)
    if away == 0.0:
        return cx + radius, cy
    return cx + (x - cx) * radius / away, cy + (y - cy) * radius / away


def _crossing(one: Circle, other: Circle, x: float, y: float) -> tuple[float, float]:
    """The least squares of two ranges that is nearer to (x, y)."""
    (ax, ay, a), (bx, by, b) = one, other
    apart = math.hypot(bx - ax, by - ay)
    ex, ey = (bx - ax) / apart, (by - ay) / apart
    if apart >= a + b:
        along, aside = (apart + a - b) / 2.0, 0.0
    elif apart <= abs(a - b):
        along, aside = ((a + apart + b) / 2.0 if a > b else (apart - a - b) / 2.0), 0.0
    else:
        along = (apart + (a - b) * (a + b) / apart) / 2.0
        aside = math.sqrt(max(a * a - along * along, 0.0))
    points = [(ax + along * ex - s * aside * ey, ay + along * ey + s * aside * ex) for s in (1.0, -1.0)]
    return min(points, key=lambda point: math.hypot(point[0] - x, point[1] - y))


def _descend(circles: Sequence[Circle], x: float, y: float) -> tuple[Floats, int]:
    """Levenberg's and Marquardt's way down the sum of squared residuals."""
    damping, cost = DAMPING, _cost(circles, x, y)
    taken = 0
    while taken < ITERATIONS:
        taken += 1
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
            x, y, cost, damping = x + step_x, y + step_y, trial, damping * 0.1
        else:
            damping *= 10.0
        if math.hypot(step_x, step_y) < ENOUGH:
            break
    return np.array([x, y]), taken


def _cost(circles: Sequence[Circle], x: float, y: float) -> float:
    return sum((math.hypot(x - cx, y - cy) - radius) ** 2 for cx, cy, radius in circles)


def _state(
    times: tuple[float, ...], points: tuple[tuple[float, float], ...], cov: Floats, prior: Floats, scene: Scene
) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of a state that two fixes tell the position and the velocity of."""
    columns, place = scene.motion.columns, list(scene.motion.position)
    mean, whole = np.zeros(len(columns)), np.diag(prior)
    mean[place] = points[-1]
    whole[place, :] = whole[:, place] = 0.0
    whole[np.ix_(place, place)] = cov
    if len(times) > 1 and "vx" in columns and "vy" in columns:
        moving, passed = [columns.index("vx"), columns.index("vy")], times[-1] - times[-2]
        mean[moving] = (np.array(points[-1]) - np.array(points[-2])) / passed
        whole[moving, :] = whole[:, moving] = 0.0
        whole[moving, moving] = 2.0 * np.diag(cov) / passed**2
    return mean, whole
