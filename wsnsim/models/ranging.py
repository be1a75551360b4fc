"""Sensors of distance: a range, a range from the origin, and the strength of a radio signal. Their noise is constant.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, 0), owners (N,) | None) -> (N,)

Sensors stand in the plane. A target whose position is one column (P = 1) moves along the x-axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final, Literal, Self

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, planar
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import LENGTH
from wsnsim.models.sensing import coordinates, fisher

REACH: Final = Quantity("m", ge=1e-3)
"""Of a sensor that may have no end: up to 1e7 m, or .inf (see `_too_long_a_reach`)."""
ERROR: Final = Quantity("m", ge=1e-6, le=1e7)
LARGEST_EXPONENT: Final = 600.0
"""e to this power is still a number, however long d0."""


class _OfDistance:
    """What the sensors here share: nothing is drawn for a node, and the kernels know the law."""

    trait_names: ClassVar[tuple[str, ...]] = ()

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 0): all are alike."""
        return np.empty((nodes, 0))

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        No readings: zeros. A point that is not finite, or a reading that is not a number: -inf.
        """
        x, y = coordinates(points)
        places = self._places(positions)
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, y, readings, places, self._law)
        return kernels.own_log_likelihood(x, y, readings, places, owners, self._law)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """At points (P, N): expected readings (S, N), their gradients (S, P, N), variances (S, N), in reach or not.

        At the sensor itself, and from a floor of the distance inwards, the gradient is 0 (our choice: there is none).
        """
        x, y = coordinates(points)
        means, gradients, variances = kernels.linearised(x, y, self._places(positions), self._law)
        return means, np.ascontiguousarray(gradients[:, : len(points)]), variances

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher's information about the position in one reading of each sensor: g gᵀ / R."""
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, 1.0 / variances)

    def assumed(self, gains: str, inflate: bool) -> Self:
        """The sensor itself: there are no gains that a filter might not know."""
        return self

    def _places(self, positions: Floats) -> Floats:
        """(S, 2) where the distances are counted from."""
        return np.ascontiguousarray(positions)

    @cached_property
    def _law(self) -> kernels.Law:
        raise NotImplementedError


@part
class Range(_OfDistance):
    """The distance to a target, with noise of a constant variance: z = d + v, v ~ N(0, R).

    Source: Liu, Wang (2012): R is 1 m², the radius 400 m, and a sensor beyond its radius reads the noise alone,
    z = v: `beyond: noise`, where every sensor has a reading. In a network such a node sleeps: `beyond: silent`.
    `own_cell` is our reading of their sensors that hand a target on: each sees its own Voronoi cell only.

    What a filter linearises is the distance whatever the radius, as in the paper; the likelihood of a particle, and
    Fisher's information, are those of the true law: a reading beyond the radius has the mean 0 and tells nothing of
    the position.
    """

    sd: Annotated[float, ERROR, "standard deviation of a reading"] = 1.0
    reach: Annotated[float, REACH, "radius within which a target is sensed; .inf: anywhere"] = 400.0
    beyond: Annotated[Literal["silent", "noise"], "what a sensor reads of a target out of reach"] = "silent"
    own_cell: Annotated[bool, "whether the sensor nearest to the target alone gets a reading"] = False

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) who gets a reading of a target at each of the points (n, P): everybody if `beyond` is noise.

        Of equally near sensors the first has the cell.
        """
        if self.beyond == "noise":
            return np.ones((len(points), len(positions)), dtype=np.bool_)
        squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=-1)
        within: Bools = squared <= self.reach * self.reach
        if self.own_cell and len(positions):
            within &= np.arange(len(positions)) == np.argmin(squared, axis=1)[:, None]
        return within

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m: pair i is a target at points[i] (n, P), a sensor at positions[i], a standard normal."""
        squared = _squared(points, positions)
        return np.where(squared <= self._within * self._within, np.sqrt(squared), 0.0) + self.sd * noise

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected: itself, floored at 0."""
        return np.maximum(readings, 0.0)

    def strength(self, reading: float) -> float:
        """The larger, the nearer: a short range is what an election looks for."""
        return -reading

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher's information about the position in one reading: g gᵀ / R; 0 where it is noise alone."""
        distances, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, np.where(distances <= self._within, 1.0 / variances, 0.0))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Readings of noise in a network, or for one cell alone; a reach beyond measure."""
        yield from _too_long_a_reach(self.reach)
        if self.beyond == "noise" and isinstance(setup, NetworkSetup):
            yield Issue(
                ("sensor", "beyond"),
                "in a network a node out of reach sleeps and reads no noise: use beyond: silent, or network: none",
            )
        if self.beyond == "noise" and self.own_cell:
            yield Issue(("sensor", "own_cell"), "with beyond: noise every sensor has a reading: use beyond: silent")

    @property
    def _within(self) -> float:
        """m: where a reading tells of the distance."""
        return self.reach if self.beyond == "noise" else math.inf

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, float(self._within), False


@part
class RangeFromOrigin(_OfDistance):
    """The target's distance from the origin, wherever the node stands: z = sqrt(x² + y²) + v, v ~ N(0, R).

    A rotation about the origin cannot be told from it.

    Source: Wei, Guo (2022), the tracking experiment; R is 1 m².
    """

    reach: ClassVar[float] = math.inf

    sd: Annotated[float, ERROR, "standard deviation of a reading"] = 1.0

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points[i] (n, P), with standard normals."""
        result: Floats = np.sqrt((points**2).sum(axis=1)) + self.sd * noise
        return result

    def _places(self, positions: Floats) -> Floats:
        return np.zeros((len(positions), 2))

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, math.inf, False


@part
class Rssi(_OfDistance):
    """The strength of a radio signal, which falls with the logarithm of the distance: z = z0 - 10 η log10(d/d0) + v.

    Source: Ruan, Wang, Yang, Zhang (2020), eq. 4; R is 1/4 dB². z0 and the floor of d are our choice: z0 is that of
    the paper's indoor fit.
    """

    z0: Annotated[float, Quantity("dBm", ge=-1e6, le=1e6), "strength at the distance d0"] = -37.8
    eta: Annotated[float, Quantity("", ge=1e-3, le=100), "η: exponent of the loss with distance"] = 2.3
    d0: Annotated[float, LENGTH, "distance at which the strength is z0"] = 1.0
    sd: Annotated[float, Quantity("dB", ge=1e-6, le=1e6), "standard deviation of a reading"] = 0.5
    floor: Annotated[float, Quantity("m", ge=1e-6, le=1e7), "no distance counts as less"] = 0.05
    reach: Annotated[float, REACH, "distance within which a target is heard; .inf: anywhere"] = math.inf

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in dBm: pair i is a target at points[i] (n, P), a sensor at positions[i], a standard normal."""
        distances = np.maximum(np.sqrt(_squared(points, positions)), self.floor)
        return self.z0 - 10.0 * self.eta * np.log10(distances / self.d0) + self.sd * noise

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, at least the floor: d0 10^((z0 - z)/(10 η))."""
        exponents = np.minimum(math.log(10.0) * (self.z0 - readings) / (10.0 * self.eta), LARGEST_EXPONENT)
        return np.maximum(self.d0 * np.exp(exponents), self.floor)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A reach beyond measure."""
        yield from _too_long_a_reach(self.reach)

    @cached_property
    def _law(self) -> kernels.Law:
        """z = a + b log d with b = -10 η / log 10 and a = z0 - b log d0 (eq. 4)."""
        slope = -10.0 * self.eta / math.log(10.0)
        offset = self.z0 - slope * math.log(self.d0)
        return offset, slope, float(self.floor), float(self.sd) ** 2, math.inf, True


def _too_long_a_reach(reach: float) -> Iterator[Issue]:
    """A reach that is finite, and longer than any length in a scenario may be."""
    if LENGTH.le is not None and LENGTH.le < reach < math.inf:
        yield Issue(("sensor", "reach"), f"must be at most {LENGTH.le:g}, or .inf, is {reach:g}")


def _squared(points: Floats, positions: Floats) -> Floats:
    """(n,) squared distances between points (n, P) and positions (n, 2)."""
    apart: Floats = planar(points) - positions
    result: Floats = (apart**2).sum(axis=1)
    return result
