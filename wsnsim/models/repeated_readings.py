"""A sensor model of means of several readings, for filters that are told of how many."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.part import part
from wsnsim.base.vector_readings import near

COUNT: Final = "count"
"""The trait of a node that is the number of readings of which its reading is the mean. It may change at each step."""


@part
class RepeatedReadings:
    """What filters assume of means of readings: the last trait of a node, `count`, says of how many.

    With Gaussian noise of a constant variance R, the n readings of a node in a step have the likelihood of n times
    their mean, but for a factor that does not depend on the state; the variance of the mean is R / n.
    """

    law: Any

    @property
    def reach(self) -> float:
        """The law's sensing range."""
        return float(self.law.reach)

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The law's traits, and the count."""
        return (*self.law.trait_names, COUNT)

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T + 1) the law's traits, and a count of 1."""
        return np.column_stack([self.law.draw_traits(nodes, rng), np.ones(nodes)])

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) means of readings, given standard normal noise."""
        own, counts = traits[:, :-1], traits[:, -1]
        expected: Floats = self.law.measure(points, positions, own, np.zeros(len(noise)))
        drawn = near(self.law, self.law.measure(points, positions, own, noise), expected)
        result: Floats = expected + (drawn - expected) / np.sqrt(counts)
        return result

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) of all readings that the means stand for, but for a constant; as `SensorModel.log_likelihood`."""
        own, counts = traits[:, :-1], traits[:, -1].astype(np.int64)
        if owners is not None and readings.size:
            result: Floats = counts[owners] * self.law.log_likelihood(points, readings, positions, own, owners)
            return result
        each = np.repeat(np.arange(readings.size), counts)
        joint: Floats = self.law.log_likelihood(points, readings[each], positions[each], own[each])
        return joint

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N), gradients (S, P, N), and the variances of the means (S, N)."""
        means, gradients, variances = self.law.linearise(points, positions, traits[:, :-1])
        return means, gradients, variances / traits[:, -1:]

    def assumed(self, gains: str, inflate: bool) -> RepeatedReadings:
        """The model that another filter assumes of the same means."""
        return RepeatedReadings(law=self.law.assumed(gains, inflate))

    def __getattr__(self, name: str) -> Any:
        """What else the law can do with a single reading, such as `ranges`: a mean is one."""
        if name.startswith("_") or name == "law":
            raise AttributeError(name)
        return getattr(self.law, name)
