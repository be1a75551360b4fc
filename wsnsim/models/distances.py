"""What all sensor models of a distance have in common: the likelihood, the linear model and the noise of readings.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

Sensors stand in the plane. A target whose position is one column (P = 1) moves along the x-axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.errors import Issue
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import LENGTH, LOG_TWO_PI
from wsnsim.models.sensing import OfPosition, coordinates, fisher, of_readings

LEAST_RANK: Final = 1e-16


class Excess(NamedTuple):
    """An error of paths that are not the line of sight: with a probability, a normal number is added."""

    probability: float
    mean: float
    sd: float


class OfDistance(OfPosition):
    """Methods of sensors whose reading depends on a distance, with a gain and a height of the node or without.

    A sensor gives `_law`. One whose nodes differ also gives `trait_names`, `draw_traits`, `_places` and `_gains`, and
    one whose noise is not normal `_dof`.
    """

    @property
    def constant_gaussian(self) -> bool:
        """Whether the noise is Gaussian: its variance is constant, so a mean of n readings has the variance R / n."""
        return self._dof == math.inf and self._excess is None

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        x, y = coordinates(points)
        places, gains = self._places(positions, traits), self._gains(traits)
        readings = readings if gains is None else readings - gains
        if readings.size and not self.constant_gaussian:
            means, _, variances = kernels.linearised(x, y, places, self._law)
            if self._excess is not None:
                logs = mixed_log_density(readings[:, None] - means, math.sqrt(self._law[3]), self._excess)
                return of_readings(logs, owners)
            return heavy_tailed_log_likelihood(readings, means, variances, self._dof, owners)
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, y, readings, places, self._law)
        return kernels.own_log_likelihood(x, y, readings, places, owners, self._law)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N) and variances (S, N), within range or not.

        The gradient is 0 at the sensor itself and below the least distance, where it is undefined (our choice). Paths
        that are not the line of sight count with their mean and variance, as if they were Gaussian.
        """
        x, y = coordinates(points)
        means, gradients, variances = kernels.linearised(x, y, self._places(positions, traits), self._law)
        gains = self._gains(traits)
        if gains is not None:
            means += gains[:, None]
        if self._excess is not None:
            chance, mean, sd = self._excess
            means, variances = means + chance * mean, variances + chance * (sd**2 + (1.0 - chance) * mean**2)
        return means, np.ascontiguousarray(gradients[:, : len(points)]), variances

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor.

        g gᵀ / R; with Student's t of ν degrees of freedom and the variance R, ν (ν + 1) / ((ν - 2) (ν + 3)) times that.
        """
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, self._weights(variances))

    def _weights(self, variances: Floats) -> Floats:
        """(S, N) the information in a reading about its mean, given its variance.

        Where lines of sight may be blocked, it is that for filters that know which are: the most that it can be.
        """
        if self._excess is None:
            return information_factor(self._dof) / variances
        chance, variance = self._excess.probability, self._law[3]
        return np.full_like(variances, (1.0 - chance) / variance + chance / (variance + self._excess.sd**2))

    def _errors(self, noise: Floats, sd: float) -> Floats:
        """(n,) errors of readings, of noise with the standard deviation `sd` along the line of sight."""
        if self._excess is None:
            return sd * unit_noise(noise, self._dof)
        return mixed_noise(noise, sd, self._excess)

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

    @property
    def _excess(self) -> Excess | None:
        """The error of paths that are not the line of sight; None: there is none."""
        return None


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


def mixed_log_density(errors: Floats, sd: float, excess: Excess) -> Floats:
    """The log density of errors with the standard deviation `sd` along the line of sight."""
    chance, mean, late = excess.probability, excess.mean, math.hypot(sd, excess.sd)
    direct = math.log1p(-chance) - 0.5 * (errors / sd) ** 2 - math.log(sd)
    other = math.log(chance) - 0.5 * ((errors - mean) / late) ** 2 - math.log(late)
    return np.logaddexp(direct, other) - 0.5 * LOG_TWO_PI


def mixed_noise(normals: Floats, sd: float, excess: Excess) -> Floats:
    """(n,) errors of readings from standard normal numbers: the lowest ranks are those of blocked lines of sight."""
    from scipy.special import ndtr, ndtri

    chance, ranks = excess.probability, ndtr(normals)
    blocked = ranks < chance
    rest = np.clip(np.where(blocked, ranks / chance, (ranks - chance) / (1.0 - chance)), LEAST_RANK, 1.0 - LEAST_RANK)
    errors: Floats = ndtri(rest) * np.where(blocked, math.hypot(sd, excess.sd), sd) + blocked * excess.mean
    return errors
