"""A sensor: the distance to the target, with noise that grows with the distance.

    python plugin_name.py           checks the rules of a sensor (wsnsim.testing.check_sensor)
    wsnsim run plugin_name.yaml     runs the scenario beside this file

Shapes: N points or particles, S sensors, P columns of the position (1 or 2). SI units throughout.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from wsnsim import Quantity, part

Floats = NDArray[np.float64]
NEAREST = 1e-9
"""m: distance below which a target counts as this far away, so that its direction is defined."""


@part
class PluginSensor:
    """The distance to the target, z = d + (sd + growth d) v with v ~ N(0, 1), within a sensing range.

    Ultrasonic and ultra-wideband ranging behave so, within limits.
    """

    trait_names: ClassVar[tuple[str, ...]] = ()

    reach: Annotated[float, Quantity("m", gt=0, le=1e7), "sensing range"] = 60.0
    sd: Annotated[float, Quantity("m", gt=0, le=1e6), "standard deviation of a reading beside the node"] = 0.5
    growth: Annotated[float, Quantity("", ge=0, le=10), "increase of the standard deviation per metre"] = 0.02

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """Return the constants of each node (nodes, T); these sensors are all alike, so T = 0."""
        return np.empty((nodes, 0))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """Return the readings (N,) of targets at points (N, P) by sensors at positions (N, 2), one by one.

        Args:
            points: Where the targets are, in m.
            positions: Where the sensors are, in m.
            traits: (N, T) the constants of the sensors.
            noise: (N,) standard normal numbers, which the simulator draws.
        """
        distances = np.hypot(*(_planar(points) - positions).T)
        readings: Floats = distances + self.deviations(distances) * noise
        return readings

    def log_likelihood(
        self,
        points: Floats,
        readings: Floats,
        positions: Floats,
        traits: Floats,
        owners: NDArray[np.int64] | None = None,
    ) -> Floats:
        """Return log p(readings | target at points) for each of the points (P, N), as (N,).

        Args:
            points: (P, N) positions of particles.
            readings: (S,) what the sensors measured.
            positions: (S, 2) where they stand.
            traits: (S, T) their constants.
            owners: (N,) None: all readings count for each particle; else reading owners[j] alone for particle j.
        """
        expected, _, variances = self.linearise(points, positions, traits)
        logs = -0.5 * ((readings[:, None] - expected) ** 2 / variances + np.log(2.0 * np.pi * variances))
        chosen: Floats = logs.sum(axis=0) if owners is None else logs[owners, np.arange(owners.size)]
        return np.where(np.isfinite(chosen), chosen, -np.inf)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Return expected readings (S, N), their gradients (S, P, N) and variances (S, N) at points (P, N)."""
        offsets = _planar(points.T)[None] - positions[:, None]  # (S, N, 2)
        distances = np.maximum(np.hypot(offsets[..., 0], offsets[..., 1]), NEAREST)
        gradients = np.moveaxis(offsets / distances[..., None], 2, 1)[:, : points.shape[0]]
        return distances, gradients, self.deviations(distances) ** 2

    def deviations(self, distances: Floats) -> Floats:
        """Return the standard deviation of a reading at each distance."""
        return self.sd + self.growth * distances

    def strength(self, reading: float) -> float:
        """Return how strong a reading is: in an election of a cluster head the strongest wins, here the nearest."""
        return -reading

    def assumed(self, gains: str, inflate: bool) -> PluginSensor:
        """Return the model that a filter assumes; a sensor without gains assumes itself."""
        return self


def _planar(points: Floats) -> Floats:
    """Return points (N, P) as points in the plane (N, 2): a target on a line has y = 0."""
    return points if points.shape[1] == 2 else np.column_stack([points[:, 0], np.zeros(len(points))])


if __name__ == "__main__":
    from wsnsim.testing import check_sensor

    check_sensor(PluginSensor())
    print("plugin_name: keeps the rules of a sensor")
