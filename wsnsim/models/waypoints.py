"""Motion models with straight legs between waypoints, which are random or given.

propagate(states (D, N), dt, keys (N,), time) -> (D, N)

The trajectory is a function of continuous time and does not depend on the length of a step. Filters do not know the
waypoints: they assume near-constant velocity with process noise of intensity q (our choice).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from wsnsim.base.arrays import Floats, rounding
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.models.bounds import LENGTH, PLACE
from wsnsim.models.csvfile import Wanted, only_rows
from wsnsim.models.linear import LinearMotion, LinearProcess, near_constant_velocity
from wsnsim.models.motion import InPlane

INTENSITY = Quantity("m2/s3", ge=0.0, le=1e9)
MOST_LEGS = 1e6
"""Greatest number of legs of a random trajectory; sampling as many takes some seconds (our choice)."""
LEAST_APART = 1e-9
"""Least time (s) between two places of a trajectory, so that speeds are finite (our choice)."""
FARTHEST_POINT = 1e9
"""Greatest time (s) and coordinate (m) of a given waypoint (our choice)."""


class Straight(InPlane, LinearMotion):
    """The state and the near-constant velocity that filters assume, of motion with straight legs."""

    continuous: ClassVar[bool] = True
    no_density: ClassVar[str] = "with q = 0 the process noise is singular and has no density; use q > 0"
    q: float

    def _process(self, dt: float) -> LinearProcess:
        return near_constant_velocity(self.q, dt)

    def assumed(self, noise_scale: float) -> Self:
        """The model that a filter assumes: process covariance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale)  # type: ignore[type-var]


@part
class RandomWaypoint(Straight):
    """The random waypoint model: straight legs between points uniform over an area, each at a random speed.

    The target may pause at each point. `begin` selects the state at time 0. `stationary`: a sample of the stationary
    distribution, so that no warm-up is needed: uniform along a leg that is chosen with probability proportional to its
    duration, with the speed of density 1/v; or in a pause. `uniform`: at a uniform point, at the start of a leg; the
    mean speed then decays over time, the model's known flaw. If the area is larger than the field, the target leaves
    the field and returns.

    Source: Johnson, Maltz (1996); Navidi, Camp (2004) and Le Boudec, Vojnovic (2005) for the stationary start. Li,
    Jiang, Zhang, Zhang (2012) give v_max; the least speed and the pauses are our choice.
    """

    width: Annotated[float, LENGTH, "width of the area, in x"] = 500.0
    height: Annotated[float, LENGTH, "height of the area, in y"] = 500.0
    centre: Annotated[tuple[float, float], PLACE, "x and y of the area's centre"] = (0.0, 0.0)
    speed: Annotated[tuple[float, float], Quantity("m/s", gt=0.0, le=1e6), "range of the speed, uniform"] = (
        1.0, 8.0,
    )  # fmt: skip
    pause: Annotated[tuple[float, float], Quantity("s", ge=0.0, le=1e9), "range of the pause, uniform"] = (
        0.0, 0.0,
    )  # fmt: skip
    begin: Annotated[Literal["stationary", "uniform"], "distribution of the state at time 0"] = "stationary"
    q: Annotated[float, INTENSITY, "intensity of the noise in the velocity that filters assume"] = 0.05

    def __post_init__(self) -> None:
        """Raises ValueError if a minimum exceeds its maximum."""
        for name, (least, most) in (("speed", self.speed), ("pause", self.pause)):
            if least > most:
                raise ValueError(f"{name}: the first is the least, the second the greatest, got {[least, most]}")

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if there are more legs than can be sampled in reasonable time."""
        legs = setup.duration / (self.mean_leg() / self.mean_speed() + sum(self.pause) / 2.0)
        if legs > MOST_LEGS:
            yield Issue(
                ("motion", "speed"),
                f"about {legs:.2g} legs in {setup.duration:g} s are too many (at most {MOST_LEGS:g}); "
                "lower it, enlarge the area, or pause",
            )

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) one trajectory. Its waypoints do not depend on `dt`."""
        return sampled(*self._legs(steps * dt, rng), steps, dt)

    def mean_speed(self) -> float:
        """The mean speed over time on a leg, in m/s: (v_max - v_min) / ln(v_max / v_min), the harmonic mean."""
        least, most = self.speed
        return least if most == least else (most - least) / math.log(most / least)

    def mean_leg(self) -> float:
        """The mean distance between two points uniform over the area, in m (Ghosh 1951)."""
        a, b = max(self.width, self.height), min(self.width, self.height)
        d = math.hypot(a, b)  # d - a is written as b²/(a + d), which does not cancel
        logs = b * b / a * math.asinh(a / b) + a * a / b * math.asinh(b / a)
        return (3.0 * d - a * a / (a + d) + (b / a) ** 2 * (b - d) + 2.5 * logs) / 15.0

    def paused_share(self) -> float:
        """The share of time that a target pauses."""
        paused = sum(self.pause) / 2.0
        return paused / (paused + self.mean_leg() / self.mean_speed())

    def _legs(self, until: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Times (n,) and points (n, 2) of the ends of all legs and pauses until `until`."""
        times, points = self._beginning(rng)
        while times[-1] <= until:
            point, speed = self._point(rng), float(rng.uniform(*self.speed))
            times.append(times[-1] + math.dist(points[-1], point) / speed)
            points.append(point)
            self._rest(times, points, float(rng.uniform(*self.pause)))
        return np.array(times), np.array(points)

    def _beginning(self, rng: np.random.Generator) -> tuple[list[float], list[tuple[float, float]]]:
        """Times and points of the first leg or pause, from time 0 on."""
        if self.begin == "uniform":
            return [0.0], [self._point(rng)]
        if rng.random() < self.paused_share():
            least, most = self.pause
            whole = math.sqrt(least * least + rng.random() * (most * most - least * least))
            times, points = [0.0], [self._point(rng)]
            self._rest(times, points, whole * rng.random())
            return times, points
        start, end = self._point(rng), self._point(rng)
        while rng.random() * math.hypot(self.width, self.height) >= math.dist(start, end):
            start, end = self._point(rng), self._point(rng)
        least, most = self.speed
        speed, share = least * (most / least) ** rng.random(), rng.random()
        here = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
        times, points = [0.0, math.dist(here, end) / speed], [here, end]
        self._rest(times, points, float(rng.uniform(*self.pause)))
        return times, points

    def _rest(self, times: list[float], points: list[tuple[float, float]], seconds: float) -> None:
        if seconds > 0.0:
            times.append(times[-1] + seconds)
            points.append(points[-1])

    def _point(self, rng: np.random.Generator) -> tuple[float, float]:
        x, y = rng.random(2).tolist()
        return self.centre[0] + (x - 0.5) * self.width, self.centre[1] + (y - 0.5) * self.height


@part
class Waypoints(Straight):
    """Straight legs at constant speed between given points with times; at rest before the first and after the last.

    Two equal points in sequence are a stop. The target may leave the field and return. The points are `points` of the
    scenario, [t, x, y] in s and m, or those of a CSV file with the columns t, x and y (`path`).
    """

    points: Annotated[
        tuple[tuple[float, float, float], ...],
        Quantity("", ge=-FARTHEST_POINT, le=FARTHEST_POINT, label="s, m, m"),
        "t, x and y of each waypoint, in s and m",
    ] = ()
    path: Annotated[str | None, "CSV file with a header that names t, x and y; other columns are ignored"] = None
    q: Annotated[float, INTENSITY, "intensity of the noise in the velocity that filters assume"] = 0.05

    def __post_init__(self) -> None:
        """Raises ValueError for less than two points, or times that do not increase."""
        if (self.path is None) == (not self.points):
            raise ValueError("give either points: [[t, x, y], ...] or the path of a file with them")
        if self.points:
            _check_points([(f"points[{i}]", point) for i, point in enumerate(self.points)], ValueError)

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) the trajectory; `rng` is not used. Raises RunError with file and line if it cannot be read."""
        rows = np.array(self._rows())
        return sampled(rows[:, 0], rows[:, 1:], steps, dt)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the file cannot be read or its points are not valid."""
        try:
            self._rows()
        except RunError as error:
            yield Issue(("motion", "path"), str(error))

    def _rows(self) -> list[tuple[float, ...]]:
        if self.path is None:
            return list(self.points)
        rows = only_rows(self.path, Wanted(numbers={name: name for name in "txy"}), "waypoints")
        points = list(zip(*(rows.numbers[name].tolist() for name in "txy"), strict=True))
        _check_points(
            [(f"{self.path}:{line}", point) for line, point in zip(rows.lines, points, strict=True)], RunError
        )
        return points


def sampled(times: Floats, points: Floats, steps: int, dt: float) -> Floats:
    """(steps + 1, 4) states at the steps of a trajectory through points (n, 2) at times (n,)."""
    now = np.arange(steps + 1) * dt
    x, y = (np.interp(now, times, axis) for axis in points.T)
    moves = np.diff(points, axis=0) / np.maximum(np.diff(times), np.finfo(np.float64).tiny)[:, None]
    leg = np.searchsorted(times, now + rounding(dt), side="right") - 1
    under_way = (leg >= 0) & (leg < len(moves))
    velocity = np.where(under_way[:, None], moves[np.clip(leg, 0, max(len(moves) - 1, 0))], 0.0)
    return np.column_stack([x, velocity[:, 0], y, velocity[:, 1]])


def _check_points(rows: list[tuple[str, tuple[float, ...]]], error: type[Exception]) -> None:
    """Raises `error` for less than two points, times that do not increase, or values that are too large."""
    if len(rows) < 2:
        raise error(f"{rows[0][0] if rows else 'points'}: at least two points are needed")
    for (_, (before, *_rest)), (place, (time, *_others)) in itertools.pairwise(rows):
        if not time - before >= LEAST_APART * (1.0 - 1e-6):  # but for the rounding of 1e-9 s
            later = f"must be later than that of the previous point, {before:g} s, by {LEAST_APART:g} s at least"
            raise error(f"{place}: its time {time:g} s {later}")
    for place, values in rows:
        if not all(abs(value) <= FARTHEST_POINT for value in values):
            raise error(f"{place}: t, x and y must be finite and within ±{FARTHEST_POINT:g}")
