"""A sensor whose readings have two components."""

from typing import Annotated, ClassVar

import numpy as np

from wsnsim import Quantity, part


@part
class Camera:
    """The offset of the target from the node along x and along y, with independent noise."""

    components: ClassVar[tuple[str, ...]] = ("across", "up")
    periods: ClassVar[tuple[float, ...]] = (0.0, 0.0)
    trait_names: ClassVar[tuple[str, ...]] = ()
    sd: Annotated[float, Quantity("m", gt=0.0), "standard deviation of an offset"] = 2.0
    reach: Annotated[float, Quantity("m", gt=0.0), "sensing range"] = 60.0

    def draw_traits(self, nodes, rng):
        return np.empty((nodes, 0))

    def measure(self, points, positions, traits, noise):
        return points - positions + self.sd * noise

    def linearise(self, points, positions, traits):
        expected = (points[None] - positions[:, :, None]).reshape(-1, points.shape[1])
        gradients = np.tile(np.eye(2)[:, :, None], (len(positions), 1, points.shape[1]))
        return expected, gradients, np.full(expected.shape, self.sd**2)

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        if not readings.size:
            return np.zeros(points.shape[1])
        apart = readings[:, :, None] - (points[None] - positions[:, :, None])
        logs = (-0.5 * (apart / self.sd) ** 2 - np.log(self.sd * np.sqrt(2.0 * np.pi))).sum(axis=1)
        chosen = logs.sum(axis=0) if owners is None else logs[owners, np.arange(owners.size)]
        return np.where(np.isfinite(chosen), chosen, -np.inf)

    def assumed(self, gains, inflate):
        return self

    def strength(self, reading):
        return -np.hypot(*reading)
