"""Sensor models of distance with constant noise: range, range from the origin, received signal strength.

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
"""A sensing range that may be infinite: up to 1e7 m, or .inf (see `_reach_issues`)."""
ERROR: Final = Quantity("m", ge=1e-6, le=1e7)
LARGEST_EXPONENT: Final = 600.0
"""e to this power times any d0 is finite."""


class _OfDistance:
    """Methods of all sensors of this module: nodes have no individual traits, and kernels compute the law."""

    trait_names: ClassVar[tuple[str, ...]] = ()

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 0) nothing: all nodes have the same sensor."""
        return np.empty((nodes, 0))

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        x, y = coordinates(points)
        places = self._places(positions)
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, y, readings, places, self._law)
        return kernels.own_log_likelihood(x, y, readings, places, owners, self._law)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N) and variances (S, N), within range or not.

        The gradient is 0 at the sensor itself and below the least distance, where it is undefined (our choice).
        """
        x, y = coordinates(points)
        means, gradients, variances = kernels.linearised(x, y, self._places(positions), self._law)
        return means, np.ascontiguousarray(gradients[:, : len(points)]), variances

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor: g gᵀ / R."""
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, 1.0 / variances)

    def assumed(self, gains: str, inflate: bool) -> Self:
        """The sensor itself: it has no gains that a filter might not know."""
        return self

    def _places(self, positions: Floats) -> Floats:
        """(S, 2) the points from which the distances are measured."""
        return np.ascontiguousarray(positions)

    @cached_property
    def _law(self) -> kernels.Law:
        raise NotImplementedError


@part
class Range(_OfDistance):
    """The distance to a target, with noise of constant variance: z = d + v, v ~ N(0, R).

    Source: Liu, Wang (2012): R is 1 m² and the range 400 m. In the paper every sensor has a reading, which is the
    noise alone, z = v, if the target is out of range (`beyond: noise`). In a network such a node has none
    (`beyond: silent`). `own_cell` is our interpretation of the paper's sensors that hand a target over: a sensor
    measures in its own Voronoi cell only.

    A filter linearises the distance without regard to the range, as in the paper. The likelihood of a particle and the
    Fisher information follow the true law: beyond the range, a reading has the mean 0 and no information.
    """

    sd: Annotated[float, ERROR, "standard deviation of a reading"] = 1.0
    reach: Annotated[float, REACH, "sensing range; .inf: unlimited"] = 400.0
    beyond: Annotated[Literal["silent", "noise"], "reading of a target out of range"] = "silent"
    own_cell: Annotated[bool, "whether only the sensor nearest to the target has a reading"] = False

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether each sensor has a reading of a target at each of the points (n, P): all if `beyond: noise`.

        With `own_cell`, the first of several equally near sensors has the reading.
        """
        if self.beyond == "noise":
            return np.ones((len(points), len(positions)), dtype=np.bool_)
        squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=-1)
        within: Bools = squared <= self.reach * self.reach
        if self.own_cell and len(positions):
            within &= np.arange(len(positions)) == np.argmin(squared, axis=1)[:, None]
        return within

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points (n, P) by sensors at positions (n, 2), with normal noise."""
        squared = _squared(points, positions)
        return np.where(squared <= self._within * self._within, np.sqrt(squared), 0.0) + self.sd * noise

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected: the reading itself, at least 0."""
        return np.maximum(readings, 0.0)

    def strength(self, reading: float) -> float:
        """The strength of a reading for an election, which grows as the range shrinks."""
        return -reading

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading: g gᵀ / R; 0 where it is noise alone."""
        distances, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, np.where(distances <= self._within, 1.0 / variances, 0.0))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for `beyond: noise` in a network or with `own_cell`, and for a range that is too long."""
        yield from _reach_issues(self.reach)
        if self.beyond == "noise" and isinstance(setup, NetworkSetup):
            yield Issue(
                ("sensor", "beyond"),
                "in a network, a node out of range has no reading: use beyond: silent, or network: none",
            )
        if self.beyond == "noise" and self.own_cell:
            yield Issue(("sensor", "own_cell"), "with beyond: noise every sensor has a reading: use beyond: silent")

    @property
    def _within(self) -> float:
        """The distance (m) up to which a reading depends on the distance."""
        return self.reach if self.beyond == "noise" else math.inf

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, float(self._within), False


@part
class RangeFromOrigin(_OfDistance):
    """The target's distance from the origin, wherever the node stands: z = sqrt(x² + y²) + v, v ~ N(0, R).

    The angle about the origin is not observable.

    Source: Wei, Guo (2022), the tracking experiment; R is 1 m².
    """

    reach: ClassVar[float] = math.inf

    sd: Annotated[float, ERROR, "standard deviation of a reading"] = 1.0

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points (n, P), with standard normal noise."""
        result: Floats = np.sqrt((points**2).sum(axis=1)) + self.sd * noise
        return result

    def _places(self, positions: Floats) -> Floats:
        return np.zeros((len(positions), 2))

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, math.inf, False


@part
class Rssi(_OfDistance):
    """Received signal strength, which falls with the logarithm of the distance: z = z0 - 10 η log10(d/d0) + v.

    Source: Ruan, Wang, Yang, Zhang (2020), eq. 4; R is 1/4 dB². z0, from the paper's indoor fit, and the least d are
    our choice.
    """

    z0: Annotated[float, Quantity("dBm", ge=-1e6, le=1e6), "strength at the distance d0"] = -37.8
    eta: Annotated[float, Quantity("", ge=1e-3, le=100), "η: exponent of the loss with distance"] = 2.3
    d0: Annotated[float, LENGTH, "distance at which the strength is z0"] = 1.0
    sd: Annotated[float, Quantity("dB", ge=1e-6, le=1e6), "standard deviation of a reading"] = 0.5
    floor: Annotated[float, Quantity("m", ge=1e-6, le=1e7), "least distance: shorter ones are taken as this"] = 0.05
    reach: Annotated[float, REACH, "sensing range; .inf: unlimited"] = math.inf

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in dBm of targets at points (n, P) by sensors at positions (n, 2), with normal noise."""
        distances = np.maximum(np.sqrt(_squared(points, positions)), self.floor)
        return self.z0 - 10.0 * self.eta * np.log10(distances / self.d0) + self.sd * noise

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, at least `floor`: d0 10^((z0 - z)/(10 η))."""
        exponents = np.minimum(math.log(10.0) * (self.z0 - readings) / (10.0 * self.eta), LARGEST_EXPONENT)
        return np.maximum(self.d0 * np.exp(exponents), self.floor)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the range is finite and too long."""
        yield from _reach_issues(self.reach)

    @cached_property
    def _law(self) -> kernels.Law:
        """z = a + b log d with b = -10 η / log 10 and a = z0 - b log d0 (eq. 4)."""
        slope = -10.0 * self.eta / math.log(10.0)
        offset = self.z0 - slope * math.log(self.d0)
        return offset, slope, float(self.floor), float(self.sd) ** 2, math.inf, True


def _reach_issues(reach: float) -> Iterator[Issue]:
    """Yield an issue if the range is finite and longer than the greatest length of a scenario."""
    if LENGTH.le is not None and LENGTH.le < reach < math.inf:
        yield Issue(("sensor", "reach"), f"must be at most {LENGTH.le:g}, or .inf, is {reach:g}")


def _squared(points: Floats, positions: Floats) -> Floats:
    """(n,) squared distances between points (n, P) and positions (n, 2)."""
    apart: Floats = planar(points) - positions
    result: Floats = (apart**2).sum(axis=1)
    return result
