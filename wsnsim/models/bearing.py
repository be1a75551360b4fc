"""Sensor models of directions: bearing, and range with bearing.

log_likelihood(points (P, N), readings (S,) or (S, 2), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

T is 1, the heading of a node in rad, where nodes have headings of their own, else 0. Sensors stand in the plane. A
target whose position is one column (P = 1) moves along the x-axis.

The noise of an angle is a wrapped normal. Its density is taken as that of a normal at the shortest difference of two
angles: the terms of further turns are left out. With the largest `sd` that is allowed, 0.5 rad, they are less than
1e-16 of the density within a quarter of a turn from the expected angle, and less than 1e-9 of the whole probability.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Reading, planar
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.models.bounds import ACCURACY, LENGTH, LOG_TWO_PI
from wsnsim.models.distances import reach_issues
from wsnsim.models.ranging import REACH
from wsnsim.models.sensing import OfPosition, coordinates, fisher

TURN: Final = 2.0 * math.pi
HEADING: Final = "heading"
"""The trait of a node that is the direction of its own axis in rad, anticlockwise from the x-axis."""
ANGLE_ERROR: Final = Quantity("rad", ge=1e-6, le=0.5)
WHOSE_AXIS: Final = "axis from which bearings are measured: the x-axis for all, or one of each node, which filters know"
LEAST: Final = "least distance: a node has no reading of a nearer target"


@part
class OfDirection(OfPosition):
    """The base of sensors of directions. A subclass gives `components` with their `periods`, and `deviations`.

    The components are a bearing, or a range and a bearing.
    """

    reach: Annotated[float, REACH, "sensing range; .inf: unlimited"] = 60.0
    least: Annotated[float, LENGTH, LEAST] = 1.0
    heading: Annotated[Literal["common", "own"], WHOSE_AXIS] = "common"
    components: ClassVar[tuple[str, ...]]

    @property
    def deviations(self) -> tuple[float, ...]:
        """The standard deviation of each component of a reading."""
        raise NotImplementedError

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The heading of a node, if each has its own."""
        return (HEADING,) if self.heading == "own" else ()

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) the heading of each node in rad, uniform over a turn; no column where all have the same."""
        if self.heading == "own":
            return rng.uniform(-math.pi, math.pi, (nodes, 1))
        return np.empty((nodes, 0))

    @property
    def reading_space(self) -> tuple[tuple[float, float], ...]:
        """The interval in which each component may be: up to the sensing range, and a turn."""
        turn = (-math.pi, math.pi)
        return ((0.0, self.reach), turn) if len(self.components) > 1 else (turn,)

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether a target at each of the points (n, P) is between `least` and `reach` of each sensor."""
        squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=-1)
        between: Bools = (squared >= self.least**2) & (squared <= self.reach**2)
        return between

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) or (n, M) readings of targets at points (n, P), with as many standard normal numbers; angles in ±π."""
        dx, dy = (planar(points) - positions).T.copy()
        expected = self._expected(_Lines(dx, dy), self._headings(traits))
        errors = np.array(self.deviations) * noise.reshape(len(noise), len(self.deviations))
        readings = np.stack(expected, axis=-1) + errors
        readings[:, -1] = wrapped(readings[:, -1])  # the bearing is the last component
        return readings.reshape(noise.shape)

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        if not readings.size:
            return np.zeros(points.shape[1])
        if owners is None:
            lines, headings = _lines(points, positions[:, None]), self._headings(traits)[:, None]
            measured = readings.reshape(len(readings), len(self.deviations), 1)
        else:
            lines, headings = _lines(points, positions[owners]), self._headings(traits)[owners]
            measured = readings.reshape(len(readings), len(self.deviations))[owners].T[None]
        expected = self._expected(lines, headings)
        total = np.zeros(points.shape[1])
        with np.errstate(invalid="ignore", over="ignore"):
            for component, deviation in enumerate(self.deviations):
                difference = measured[:, component] - expected[component].reshape(len(measured), -1)
                difference = wrapped(difference) if component == len(expected) - 1 else difference
                total += -0.5 * ((difference / deviation) ** 2 + 2.0 * math.log(deviation) + LOG_TWO_PI).sum(axis=0)
        known = np.isfinite(total) & np.isfinite(points).all(axis=0)
        return np.where(known, total, -np.inf)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S M, N) at points (P, N), gradients (S M, P, N) and variances (S M, N), node by node.

        Nearer than `least`, the gradient of a bearing is that at `least` times the distance over `least`. At the sensor
        itself, and infinitely far away, gradients are 0 (our choice).
        """
        lines, count = _lines(points, positions[:, None]), len(self.deviations)
        shape = (len(positions) * count, points.shape[1])
        means = np.stack(self._expected(lines, self._headings(traits)[:, None]), axis=1).reshape(shape)
        gradients = np.stack(self._gradients(lines), axis=1).reshape(shape[0], 2, shape[1])
        variances = np.tile(np.array(self.deviations) ** 2, len(positions))
        return means, np.ascontiguousarray(gradients[:, : len(points)]), np.repeat(variances[:, None], shape[1], axis=1)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor: the sum of g gᵀ / R."""
        _, gradients, variances = self.linearise(points, positions, traits)
        each = fisher(gradients, 1.0 / variances)
        total: Floats = each.reshape(len(positions), len(self.deviations), *each.shape[1:]).sum(axis=1)
        return total

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a sensing range that is too long, or not longer than the least distance."""
        yield from reach_issues(self.reach)
        if not self.least < self.reach:
            yield Issue(("sensor", "least"), f"must be below the sensing range of {self.reach:g} m, is {self.least:g}")

    def _headings(self, traits: Floats) -> Floats:
        """(S,) the direction of each node's axis."""
        return traits[:, 0] if self.heading == "own" else np.zeros(len(traits))

    def _expected(self, lines: _Lines, headings: Floats) -> list[Floats]:
        """Each component of the readings along lines: (n,) or (S, N)."""
        bearing = wrapped(np.arctan2(lines.dy, lines.dx) - headings)
        return [lines.distances, bearing] if len(self.components) > 1 else [bearing]

    def _gradients(self, lines: _Lines) -> list[Floats]:
        """The gradient (S, 2, N) of each component."""
        dx, dy = lines
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            squared = np.maximum(dx**2 + dy**2, self.least**2)
            slopes = [np.stack([-dy / squared, dx / squared], axis=1)]
            if len(self.components) > 1:
                slopes.insert(0, np.stack([dx / lines.distances, dy / lines.distances], axis=1))
        return [np.where(np.isfinite(slope), slope, 0.0) for slope in slopes]


@part
class Bearing(OfDirection):
    """The direction from a node to a target, anticlockwise from an axis in rad: z = atan2(Δy, Δx) - heading + v.

    v ~ N(0, R), wrapped into ±π. A reading has no strength: all candidates of an election are equal.

    Source: Bar-Shalom, Li, Kirubarajan (2001), section 3.7, whose bearings have normal noise; Mardia, Jupp (2000),
    section 3.5.7, for the wrapped normal. The least distance, below which no bearing is defined, is our choice.
    """

    components: ClassVar[tuple[str, ...]] = ("bearing",)
    periods: ClassVar[tuple[float, ...]] = (TURN,)
    constant_gaussian: ClassVar[bool] = True
    reading_limits: ClassVar[tuple[float, float]] = (-TURN, TURN)
    """Least and greatest bearing (rad) that may be recorded: more would be degrees."""

    sd: Annotated[float, ANGLE_ERROR, "standard deviation of a bearing"] = 0.035

    @property
    def deviations(self) -> tuple[float]:
        """The standard deviation in rad."""
        return (self.sd,)

    def strength(self, reading: Reading) -> float:
        """0: a bearing says nothing about the distance."""
        return 0.0


@part
class RangeBearing(OfDirection):
    """The distance of a target in m and its direction in rad, with independent noise, like those of a radar.

    z = (d + v, atan2(Δy, Δx) - heading + w), v ~ N(0, range_sd²), w ~ N(0, bearing_sd²), wrapped into ±π.

    Source: the polar measurements of Bar-Shalom, Li, Kirubarajan (2001), section 10.4.
    """

    components: ClassVar[tuple[str, ...]] = ("range", "bearing")
    periods: ClassVar[tuple[float, ...]] = (0.0, TURN)

    range_sd: Annotated[float, ACCURACY, "standard deviation of a range"] = 1.0
    bearing_sd: Annotated[float, ANGLE_ERROR, "standard deviation of a bearing"] = 0.035

    @property
    def deviations(self) -> tuple[float, float]:
        """The standard deviations in m and in rad."""
        return self.range_sd, self.bearing_sd

    def strength(self, reading: Reading) -> float:
        """The strength of a reading for an election, which grows as the range shrinks."""
        assert isinstance(reading, tuple), "a reading is a range and a bearing"
        return -reading[0]


class _Lines(NamedTuple):
    """The lines from sensors to points: their components along x and y, in m."""

    dx: Floats
    dy: Floats

    @property
    def distances(self) -> Floats:
        """Their lengths."""
        return np.hypot(self.dx, self.dy)


def wrapped(angles: Floats) -> Floats:
    """Angles in rad, moved by whole turns into ±π."""
    return angles - TURN * np.round(angles / TURN)


def _lines(points: Floats, positions: Floats) -> _Lines:
    """(S, N) the lines from each of the sensors (S, 2) to each of the points (P, N)."""
    x, y = coordinates(points)
    return _Lines(x - positions[..., 0], y - positions[..., 1])
