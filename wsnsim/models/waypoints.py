"""Targets that go straight from one point to the next: points drawn at random, or given.

propagate(states (D, N), dt, keys (N,), time) -> (D, N)

The way is a function of continuous time, sampled at the steps: the same way at any step. Filters do not know where a
target is going: what they believe is near-constant velocity, with process noise of intensity q (our choice).
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from wsnsim.base.arrays import Floats, Keys, stateful
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import linear as kernels
from wsnsim.models.bounds import LENGTH, PLACE
from wsnsim.models.csvfile import read_columns
from wsnsim.models.linear import LinearProcess

INTENSITY = Quantity("m2/s3", ge=0.0, le=1e9)
MOST_LEGS = 1e6
"""Of a random way: some seconds of drawing (our choice)."""
FARTHEST_POINT = 1e9
"""s or m, of a given point (our choice)."""


class _Straight:
    """What both have in common: four columns, and what filters believe."""

    columns: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")
    units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m", "m/s")
    position: ClassVar[tuple[int, ...]] = (0, 2)
    continuous: ClassVar[bool] = True
    q: float

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """(4, N): each state one step on, as filters believe: near-constant velocity, with process noise."""
        process = near_constant_velocity(self.q, dt)
        return kernels.propagate(stateful(states, 4), keys, process.transition, process.root)

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """(4, N): each state one step on, without noise."""
        return kernels.advance(stateful(states, 4), near_constant_velocity(self.q, dt).transition)

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """F (N, 4, 4), one read-only matrix seen N times, and the process covariance (4, 4)."""
        process = near_constant_velocity(self.q, dt)
        return np.broadcast_to(process.transition, (states.shape[1], 4, 4)), process.covariance.copy()

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """(N,) log p(after | before). Raises RunError where q = 0: there is no density."""
        if self.q <= 0.0:
            raise RunError("motion: with q = 0 the process noise is singular and has no density; use q > 0")
        process = near_constant_velocity(self.q, dt)
        return kernels.log_transition(stateful(after, 4), stateful(before, 4), process.transition, process.root)

    def assumed(self, noise_scale: float) -> Self:
        """The model as a filter believes it: process covariance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale)  # type: ignore[type-var]


@part
class RandomWaypoint(_Straight):
    """Straight legs between points uniform over an area, each at a speed of its own, with a pause at each point or not.

    `stationary`: the process starts as it is found after a long time, so that no warm-up is needed: on a leg that is
    drawn with probability proportional to its duration, uniformly along it, its speed with density 1/v; or in a pause.
    `uniform`: at a point of the area, about to set out; then the target slows down as time goes by, the model's known
    flaw. The area may be larger than the field: the target leaves, and returns.

    Source: Johnson, Maltz (1996); Navidi, Camp (2004) and Le Boudec, Vojnovic (2005) for the stationary start. Li,
    Jiang, Zhang, Zhang (2012) gives v_max; the least speed and the pauses are our choice.
    """

    width: Annotated[float, LENGTH, "of the area, in x"] = 500.0
    height: Annotated[float, LENGTH, "of the area, in y"] = 500.0
    centre: Annotated[tuple[float, float], PLACE, "of the area"] = (0.0, 0.0)
    speed: Annotated[tuple[float, float], Quantity("m/s", gt=0.0, le=1e6), "least and greatest, uniform between"] = (
        1.0, 8.0,
    )  # fmt: skip
    pause: Annotated[tuple[float, float], Quantity("s", ge=0.0, le=1e9), "least and longest, uniform between"] = (
        0.0, 0.0,
    )  # fmt: skip
    begin: Annotated[Literal["stationary", "uniform"], "how it is found at time 0"] = "stationary"
    q: Annotated[float, INTENSITY, "of the noise in the velocity that filters believe in"] = 0.05

    def __post_init__(self) -> None:
        """Raises ValueError where a least value exceeds the greatest."""
        for name, (least, most) in (("speed", self.speed), ("pause", self.pause)):
            if least > most:
                raise ValueError(f"{name}: the first is the least, the second the greatest, got {[least, most]}")

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """More legs than can be drawn in reasonable time."""
        legs = setup.steps * setup.dt / (self.mean_leg() / self.mean_speed() + sum(self.pause) / 2.0)
        if legs > MOST_LEGS:
            yield Issue(
                ("motion", "speed"),
                f"about {legs:.2g} legs in {setup.steps * setup.dt:g} s are too many (at most {MOST_LEGS:g}); "
                "lower it, enlarge the area, or pause",
            )

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4): one way. Its points do not depend on how finely it is sampled."""
        return _sampled(*self._way(steps * dt, rng), steps, dt)

    def mean_speed(self) -> float:
        """Of a target on a leg, over time, in m/s: (v_max - v_min) / ln(v_max / v_min), the harmonic mean."""
        least, most = self.speed
        return least if most == least else (most - least) / math.log(most / least)

    def mean_leg(self) -> float:
        """The mean distance in m of two points uniform over the area (Ghosh 1951)."""
        a, b = max(self.width, self.height), min(self.width, self.height)
        d = math.hypot(a, b)  # the powers of a/b are gathered so that none cancels: d - a = b²/(a + d)
        logs = b * b / a * math.asinh(a / b) + a * a / b * math.asinh(b / a)
        return (3.0 * d - a * a / (a + d) + (b / a) ** 2 * (b - d) + 2.5 * logs) / 15.0

    def paused_share(self) -> float:
        """The share of time that a target pauses."""
        paused = sum(self.pause) / 2.0
        return paused / (paused + self.mean_leg() / self.mean_speed())

    def _way(self, until: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Times (n,) and points (n, 2) between which the target goes straight."""
        times, points = self._beginning(rng)
        while times[-1] <= until:
            point, speed = self._point(rng), float(rng.uniform(*self.speed))
            times.append(times[-1] + math.dist(points[-1], point) / speed)
            points.append(point)
            self._rest(times, points, float(rng.uniform(*self.pause)))
        return np.array(times), np.array(points)

    def _beginning(self, rng: np.random.Generator) -> tuple[list[float], list[tuple[float, float]]]:
        """The first leg, or pause, from time 0 on."""
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
class Waypoints(_Straight):
    """Straight legs at constant speed between given points with times; at rest before the first and after the last.

    Equal points are a stop; a target may leave the field and return. `points` in the scenario, [t, x, y] each in s and
    m; or `path`, a CSV with the columns t, x and y.
    """

    points: Annotated[
        tuple[tuple[float, float, float], ...],
        Quantity("", ge=-FARTHEST_POINT, le=FARTHEST_POINT),
        "t, x and y of each, in s and m",
    ] = ()
    path: Annotated[str | None, "CSV file with a header that names t, x and y; other columns are ignored"] = None
    q: Annotated[float, INTENSITY, "of the noise in the velocity that filters believe in"] = 0.05

    def __post_init__(self) -> None:
        """Raises ValueError for points that make no way."""
        if (self.path is None) == (not self.points):
            raise ValueError("give either points: [[t, x, y], ...] or the path of a file with them")
        if self.points:
            _check_way([(f"points[{i}]", point) for i, point in enumerate(self.points)], ValueError)

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4): the way; nothing is drawn. Raises RunError naming file and line if it cannot be read."""
        rows = np.array(self._rows())
        return _sampled(rows[:, 0], rows[:, 1:], steps, dt)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A file that cannot be read, or that holds no way."""
        try:
            self._rows()
        except RunError as error:
            yield Issue(("motion", "path"), str(error))

    def _rows(self) -> list[tuple[float, ...]]:
        if self.path is None:
            return list(self.points)
        rows = read_columns(self.path, ("t", "x", "y"), "way-points")
        _check_way(rows, RunError)
        return [values for _, values in rows]


@functools.lru_cache(maxsize=64)
def near_constant_velocity(q: float, dt: float) -> LinearProcess:
    """White noise of intensity q in the acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-7)."""
    transition = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    root: Floats = math.sqrt(q) * np.array(
        [[math.sqrt(dt**3 / 3.0), 0.0], [math.sqrt(3.0 * dt) / 2.0, math.sqrt(dt) / 2.0]]
    )
    whole: Floats = np.kron(np.eye(2), root).astype(np.float64)
    return LinearProcess(transition, whole, whole @ whole.T)


def _sampled(times: Floats, points: Floats, steps: int, dt: float) -> Floats:
    """(steps + 1, 4) of a way of n points (n, 2) at times (n,)."""
    now = np.arange(steps + 1) * dt
    x, y = (np.interp(now, times, axis) for axis in points.T)
    moves = np.diff(points, axis=0) / np.maximum(np.diff(times), np.finfo(np.float64).tiny)[:, None]
    leg = np.searchsorted(times, now, side="right") - 1
    under_way = (leg >= 0) & (leg < len(moves))
    velocity = np.where(under_way[:, None], moves[np.clip(leg, 0, max(len(moves) - 1, 0))], 0.0)
    return np.column_stack([x, velocity[:, 0], y, velocity[:, 1]])


def _check_way(rows: list[tuple[str, tuple[float, ...]]], error: type[Exception]) -> None:
    """Two points at least, at times that increase."""
    if len(rows) < 2:
        raise error(f"{rows[0][0] if rows else 'points'}: a way has two points or more")
    for (_, (before, *_rest)), (place, (time, *_others)) in itertools.pairwise(rows):
        if not time > before:
            raise error(f"{place}: its time {time:g} s must be later than that of the point before, {before:g} s")
    for place, values in rows:
        if not all(abs(value) <= FARTHEST_POINT for value in values):
            raise error(f"{place}: t, x and y must be finite, and within ±{FARTHEST_POINT:g}")
