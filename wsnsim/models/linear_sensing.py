"""The sensor model of a coordinate: a linear measurement of the position, for which the Kalman filter is exact.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, 1), owners (N,) | None) -> (N,)
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.part import Quantity, part
from wsnsim.models.sensing import fisher

LOG_TWO_PI = math.log(2.0 * math.pi)


@part
class Coordinate:
    """The target's coordinate along the node's own axis: z = x cos θ + y sin θ + v, v ~ N(0, R).

    Each node has a constant θ, uniform over half a turn; a target on a line has y = 0. Every node measures the target,
    wherever either is. With a linear motion the posterior is Gaussian: a reference for the consistency of filters.

    Source: the linear measurement model of Bar-Shalom, Li, Kirubarajan (2001), section 5.2; the axes are our choice.
    """

    trait_names: ClassVar[tuple[str, ...]] = ("theta",)
    reach: ClassVar[float] = math.inf
    linear_gaussian: ClassVar[bool] = True

    sd: Annotated[float, Quantity("m", ge=1e-6, le=1e7), "standard deviation of a reading"] = 1.0

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
        logs = -0.5 * residuals**2 - math.log(self.sd) - 0.5 * LOG_TWO_PI
        chosen = logs.sum(axis=0) if owners is None else logs[owners, np.arange(owners.size)]
        return np.where(np.isfinite(chosen), chosen, -np.inf)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N) and variances (S, N)."""
        axes = _axes(traits)[:, : len(points)]
        gradients = np.repeat(axes[:, :, None], points.shape[1], axis=2)
        return axes @ points, gradients, np.full((len(axes), points.shape[1]), self.sd**2)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor: g gᵀ / R."""
        _, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, 1.0 / variances)

    def assumed(self, gains: str, inflate: bool) -> Self:
        """The sensor itself: it has no gains that a filter might not know."""
        return self


def _axes(traits: Floats) -> Floats:
    """(n, 2) unit vectors along the axes."""
    return np.column_stack([np.cos(traits[:, 0]), np.sin(traits[:, 0])])
