"""Sensor models of a distance: range and range from the origin, and what all sensors of a distance have in common.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

Sensors stand in the plane. A target whose position is one column (P = 1) moves along the x-axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, planar
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import ACCURACY, LENGTH
from wsnsim.models.sensing import OfPosition, coordinates, fisher, of_readings

REACH: Final = Quantity("m", ge=1e-3)
"""A sensing range that may be infinite: up to 1e7 m, or .inf (see `reach_issues`)."""
FITTED_ON: Final = "digests of the files of readings that the law was fitted to, as `wsnsim fit` writes them"


class OfDistance(OfPosition):
    """Methods of sensors whose reading depends on a distance, with a gain and a height of the node or without.

    A sensor gives `_law`. One whose nodes differ also gives `trait_names`, `draw_traits`, `_places` and `_gains`, and
    one whose noise is not normal `_dof`.
    """

    @property
    def constant_gaussian(self) -> bool:
        """Whether the noise is Gaussian: its variance is constant, so a mean of n readings has the variance R / n."""
        return self._dof == math.inf

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        x, y = coordinates(points)
        places, gains = self._places(positions, traits), self._gains(traits)
        readings = readings if gains is None else readings - gains
        if readings.size and self._dof < math.inf:
            means, _, variances = kernels.linearised(x, y, places, self._law)
            return heavy_tailed_log_likelihood(readings, means, variances, self._dof, owners)
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, y, readings, places, self._law)
        return kernels.own_log_likelihood(x, y, readings, places, owners, self._law)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N) and variances (S, N), within range or not.

        The gradient is 0 at the sensor itself and below the least distance, where it is undefined (our choice).
        """
        x, y = coordinates(points)
        means, gradients, variances = kernels.linearised(x, y, self._places(positions, traits), self._law)
        gains = self._gains(traits)
        if gains is not None:
            means += gains[:, None]
        return means, np.ascontiguousarray(gradients[:, : len(points)]), variances

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor.

        g gᵀ / R; with Student's t of ν degrees of freedom and the variance R, ν (ν + 1) / ((ν - 2) (ν + 3)) times that.
        """
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, information_factor(self._dof) / variances)

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        """(S, 2) the points from which distances are measured, or (S, 3) with the squared difference in height."""
        return np.ascontiguousarray(positions)

    def _gains(self, traits: Floats) -> Floats | None:
        """(S,) what is added to the readings of each sensor; None: nothing."""
        return None

    @cached_property
    def _law(self) -> kernels.Law:
        raise NotImplementedError

    @property
    def _dof(self) -> float:
        """Degrees of freedom ν of the noise as Student's t; infinite: normal."""
        return math.inf


def information_factor(dof: float) -> float:
    """Fisher information in one reading, times its variance: 1 for normal noise, more for Student's t.

    The information of Student's t of scale s about its location is (ν + 1) / ((ν + 3) s²), and its variance is
    s² ν / (ν - 2). Lange, Little, Taylor (1989), appendix B.
    """
    return 1.0 if math.isinf(dof) else dof * (dof + 1.0) / ((dof - 2.0) * (dof + 3.0))


def heavy_tailed_log_likelihood(
    readings: Floats, means: Floats, variances: Floats, dof: float, owners: Ints | None
) -> Floats:
    """(N,) log density of readings (S,) with noise of Student's t: means and variances (S, N); as `log_likelihood`.

    The variance of the noise is that given: its scale is s² = R (ν - 2) / ν.
    """
    scales = variances * ((dof - 2.0) / dof)
    constant = math.lgamma(0.5 * (dof + 1.0)) - math.lgamma(0.5 * dof) - 0.5 * math.log(dof * math.pi)
    logs = np.log1p((readings[:, None] - means) ** 2 / (dof * scales))
    return of_readings(constant - 0.5 * np.log(scales) - 0.5 * (dof + 1.0) * logs, owners)


def unit_noise(normals: Floats, dof: float) -> Floats:
    """(n,) noise of Student's t with the variance 1, from standard normal numbers: the quantiles of equal rank."""
    if math.isinf(dof):
        return normals
    from scipy.special import ndtr, stdtrit

    quantiles: Floats = -stdtrit(dof, ndtr(-np.abs(normals)))
    return np.copysign(quantiles, normals) * math.sqrt((dof - 2.0) / dof)


def reach_issues(reach: float) -> Iterator[Issue]:
    """Yield an issue if the range is finite and longer than the greatest length of a scenario."""
    if LENGTH.le is not None and LENGTH.le < reach < math.inf:
        yield Issue(("sensor", "reach"), f"must be at most {LENGTH.le:g}, or .inf, is {reach:g}")


def squared_distances(points: Floats, positions: Floats) -> Floats:
    """(n,) squared distances in the plane between points (n, P) and positions (n, 2)."""
    apart: Floats = planar(points) - positions
    result: Floats = (apart**2).sum(axis=1)
    return result


GREATEST_RANGE: Final = 1e7
"""Greatest range (m) in a recording, the greatest length in a scenario: the sensing range does not bound it."""
DEVIATIONS: Final = 10.0
"""A recorded range may be below 0 by this many standard deviations (our choice): noise exceeds it in 1 of 1e23."""


@part
class Range(OfDistance):
    """The distance to a target, with noise of constant variance: z = d + v, v ~ N(0, R).

    Source: Liu, Wang (2012): R is 1 m² and the range 400 m. In the paper every sensor has a reading, which is the
    noise alone, z = v, if the target is out of range (`beyond: noise`). In a network such a node has none
    (`beyond: silent`). `own_cell` is our interpretation of the paper's sensors that hand a target over: a sensor
    measures in its own Voronoi cell only.

    A filter linearises the distance without regard to the range, as in the paper. The likelihood of a particle and the
    Fisher information follow the true law: beyond the range, a reading has the mean 0 and no information.
    """

    sd: Annotated[float, ACCURACY, "standard deviation of a reading"] = 1.0
    reach: Annotated[float, REACH, "sensing range; .inf: unlimited"] = 400.0
    beyond: Annotated[Literal["silent", "noise"], "reading of a target out of range"] = "silent"
    own_cell: Annotated[bool, "whether only the sensor nearest to the target has a reading"] = False
    fitted_on: Annotated[tuple[str, ...], FITTED_ON] = ()

    @property
    def reading_limits(self) -> tuple[float, float]:
        """Least and greatest range (m) that may be recorded: noise makes that of a small distance negative."""
        return -DEVIATIONS * self.sd, GREATEST_RANGE

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
        squared = squared_distances(points, positions)
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
        yield from reach_issues(self.reach)
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
class RangeFromOrigin(OfDistance):
    """The target's distance from the origin, wherever the node stands: z = sqrt(x² + y²) + v, v ~ N(0, R).

    The angle about the origin is not observable.

    Source: Wei, Guo (2022), the tracking experiment; R is 1 m².
    """

    reach: ClassVar[float] = math.inf

    sd: Annotated[float, ACCURACY, "standard deviation of a reading"] = 1.0

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points (n, P), with standard normal noise."""
        result: Floats = np.sqrt((points**2).sum(axis=1)) + self.sd * noise
        return result

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        return np.zeros((len(positions), 2))

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, math.inf, False
