"""Sensor models of acoustic energy, and of a coordinate: a linear measurement, for which the Kalman filter is exact.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

Sensors stand in the plane. A target whose position is one column (P = 1) moves along the x-axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import SensorModel
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import acoustic as kernels
from wsnsim.models.bounds import ACCURACY, LENGTH, LOG_TWO_PI, POWER_OF_SOUND

LEAST_DISTANCE = 1.0
"""m: shorter distances are taken as this, since d^-α is unbounded (our choice)."""


class OfEnergy:
    """What the two models of acoustic energy have in common. A model gives `_law` and `_gains`."""

    trait_names: ClassVar[tuple[str, ...]] = ("gain",)
    additive: ClassVar[bool] = True
    """A reading adds up the energy of all targets."""

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        x, y = coordinates(points)
        positions, gains = np.ascontiguousarray(positions), self._gains(traits)
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, y, readings, positions, gains, self._law)
        return kernels.own_log_likelihood(x, y, readings, positions, gains, owners, self._law)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), their gradients (S, P, N) and their variances (S, N)."""
        x, y = coordinates(points)
        places, gains = np.ascontiguousarray(positions), self._gains(traits)
        means, gradients, variances = kernels.linearised(x, y, places, gains, self._law)
        return means, np.ascontiguousarray(gradients[:, : len(points)]), variances

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in the mean and the variance of one reading per sensor.

        R = (2c/N_sam) μ² + i s² with s = μ - σ² and the inflation i has the slope ∂R = 2 ((2c/N_sam) μ + i s) ∂μ.
        """
        noise, _, _, spread, inflation = self._law
        means, gradients, variances = self.linearise(points, positions, traits)
        slopes = 2.0 * (spread * means + inflation * (means - noise))
        return fisher(gradients, 1.0 / variances + 0.5 * (slopes / variances) ** 2)

    def energy_law(self, traits: Floats) -> tuple[kernels.Law, Floats]:
        """The law for the kernels, and the gains (S,) of sensors with traits (S, 1)."""
        return self._law, self._gains(traits)

    def _gains(self, traits: Floats) -> Floats:
        """(S,) the gain of each sensor."""
        raise NotImplementedError

    @cached_property
    def _law(self) -> kernels.Law:
        """The constants for the kernels."""
        raise NotImplementedError


@part
class AcousticEnergy(OfEnergy):
    """The energy of a sound, averaged over samples, which falls with a power of the distance.

    μ = σ² + g I d^-α, R = (2c/N_sam) μ², z = μ + N(0, R). R depends on the state, so log R stays in the likelihood.
    Each node has a constant gain g, uniform within ±`gain_spread` of 1.

    Source: Jiang, Song, Lin (2013), eqs. 5-8 and table 2. The paper gives neither I nor σ²: with ours, signal and
    noise are about equal at the sensing range.
    """

    reach: Annotated[float, LENGTH, "R_s: sensing range"] = 60.0
    decay: Annotated[float, Quantity("", gt=0, le=100), "α: exponent of the loss with distance"] = 2.2
    samples: Annotated[int, Quantity("", ge=1, le=10**12), "N_sam: number of samples averaged in a reading"] = 1000
    nonlinearity: Annotated[float, Quantity("", ge=1e-9, le=1e9), "c: factor of the variance of a reading"] = 1.5
    intensity: Annotated[float, POWER_OF_SOUND, "I: energy of the target's sound at 1 m"] = 1e4
    noise: Annotated[float, POWER_OF_SOUND, "σ²: energy of the background noise"] = 1.0
    gain_spread: Annotated[float, Quantity("", ge=0, lt=1), "γ: half the width of the gains about 1"] = 0.3

    @property
    def gain_variance(self) -> float:
        """The variance γ²/3 of the gains."""
        return self.gain_spread**2 / 3.0

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 1) the gain of each node."""
        return rng.uniform(1.0 - self.gain_spread, 1.0 + self.gain_spread, (nodes, 1))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings (eqs. 6-8) of targets at points (n, P) by sensors at positions (n, 2), with normal noise."""
        squared = np.maximum(((planar(points) - positions) ** 2).sum(axis=1), LEAST_DISTANCE**2)
        mean = self.noise + traits[:, 0] * self.intensity * squared ** (-self.decay / 2)
        result: Floats = mean * (1.0 + np.sqrt(2.0 * self.nonlinearity / self.samples) * noise)
        return result

    def assumed(self, gains: str, inflate: bool) -> AcousticEnergy | UncalibratedAcousticEnergy:
        """The model that a filter assumes: gains are 'known' (calibrated nodes) or 'unknown' (taken as 1)."""
        return self if gains == "known" else UncalibratedAcousticEnergy(sensor=self, inflate=inflate)

    def _gains(self, traits: Floats) -> Floats:
        return np.ascontiguousarray(traits[:, 0])

    @cached_property
    def _law(self) -> kernels.Law:
        return self.law()

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """The constants for the kernels; `inflation` times the squared signal is added to the variance."""
        return self.noise, self.intensity, self.decay, 2.0 * self.nonlinearity / self.samples, inflation


@part
class UncalibratedAcousticEnergy(OfEnergy):
    """The model that a filter assumes of an `AcousticEnergy` whose gains it does not know: every gain is 1.

    With `inflate`, the variance of the gain times the squared signal is added: R' = R + (γ²/3) (I d^-α)², with γ²/3 =
    0.03 at ±30 %. The paper does not have it; it is our choice.
    """

    sensor: AcousticEnergy
    inflate: bool

    @property
    def reach(self) -> float:
        """The sensing range R_s of the true sensor, in m."""
        return self.sensor.reach

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 1) ones: the gain of every node."""
        return np.ones((nodes, 1))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings of sensors whose gain is 1, with the variance that the filter assumes."""
        means, _, variances = self.linearise(points.T, positions, traits)
        return np.diagonal(means) + np.sqrt(np.diagonal(variances)) * noise

    def assumed(self, gains: str, inflate: bool) -> AcousticEnergy | UncalibratedAcousticEnergy:
        """The model that another filter assumes of the same sensor."""
        return self.sensor.assumed(gains, inflate)

    def _gains(self, traits: Floats) -> Floats:
        return np.ones(len(traits))

    @cached_property
    def _law(self) -> kernels.Law:
        return self.sensor.law(self.sensor.gain_variance if self.inflate else 0.0)


def coordinates(points: Floats) -> tuple[Floats, Floats]:
    """x (N,) and y (N,) of points (P, N); points of one coordinate lie on the x-axis."""
    x = np.ascontiguousarray(points[0])
    return x, np.ascontiguousarray(points[1]) if len(points) == 2 else np.zeros(x.size)


class OfLaw:
    """The base of sensor models whose readings follow those of another one, the `law`: as the law, but for changes."""

    law: SensorModel

    @property
    def reach(self) -> float:
        """The law's sensing range."""
        return float(self.law.reach)

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The law's traits."""
        return self.law.trait_names

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) as the law."""
        return self.law.draw_traits(nodes, rng)

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings that the law would give."""
        return self.law.measure(points, positions, traits, noise)

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) as the law."""
        return self.law.log_likelihood(points, readings, positions, traits, owners)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings, gradients and variances, as the law."""
        return self.law.linearise(points, positions, traits)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield the issues of the law."""
        for issue in self.law.check(setup) if hasattr(self.law, "check") else ():
            path = ("sensor", "law", *issue.path[1:]) if issue.path[:1] == ("sensor",) else issue.path
            yield Issue(path, issue.message)


def of_readings(logs: Floats, owners: Ints | None) -> Floats:
    """(N,) the log-likelihoods (S, N) of all readings, or of reading owners[j] for point j; -inf where not finite."""
    chosen = logs.sum(axis=0) if owners is None else logs[owners, np.arange(owners.size)]
    return np.where(np.isfinite(chosen), chosen, -np.inf)


def fisher(gradients: Floats, weights: Floats) -> Floats:
    """(S, P, P, N) w g gᵀ of gradients (S, P, N) and weights (S, N): 1/R where the variance does not change."""
    scaled = gradients * weights[:, None, :]
    return gradients[:, :, None, :] * scaled[:, None, :, :]


class OfPosition:
    """What sensors have in common that measure the position, all in the same way and without gains."""

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of a node's traits: none, all nodes have the same sensor."""
        return ()

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 0) nothing: all nodes have the same sensor."""
        return np.empty((nodes, 0))

    def assumed(self, gains: str, inflate: bool) -> Any:
        """The sensor itself: it has no gains that a filter might not know."""
        return self


@part
class Coordinate(OfPosition):
    """The target's coordinate along the node's own axis: z = x cos θ + y sin θ + v, v ~ N(0, R).

    Each node has a constant θ, uniform over half a turn; a target on a line has y = 0. Every node measures the target,
    wherever either is. With a linear motion the posterior is Gaussian: a reference for the consistency of filters.

    Source: the linear measurement model of Bar-Shalom, Li, Kirubarajan (2001), section 5.2; the axes are our choice.
    """

    reach: ClassVar[float] = math.inf
    linear_gaussian: ClassVar[bool] = True
    constant_gaussian: ClassVar[bool] = True

    sd: Annotated[float, ACCURACY, "standard deviation of a reading"] = 1.0

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The direction of the node's axis."""
        return ("theta",)

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, 1) the direction θ of each node's axis, in rad."""
        return rng.uniform(0.0, math.pi, (nodes, 1))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points (n, P), with standard normal noise."""
        result: Floats = (planar(points) * _axes(traits)).sum(axis=1) + self.sd * noise
        return result

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        if not readings.size:
            return np.zeros(points.shape[1])
        with np.errstate(invalid="ignore"):
            residuals = (readings[:, None] - _axes(traits)[:, : len(points)] @ points) / self.sd
        return of_readings(-0.5 * residuals**2 - math.log(self.sd) - 0.5 * LOG_TWO_PI, owners)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N) and variances (S, N)."""
        axes = _axes(traits)[:, : len(points)]
        gradients = np.repeat(axes[:, :, None], points.shape[1], axis=2)
        return axes @ points, gradients, np.full((len(axes), points.shape[1]), self.sd**2)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor: g gᵀ / R."""
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, 1.0 / variances)


def _axes(traits: Floats) -> Floats:
    """(n, 2) unit vectors along the axes."""
    return np.column_stack([np.cos(traits[:, 0]), np.sin(traits[:, 0])])
