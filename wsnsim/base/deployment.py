"""The monitored rectangle, and the port of the components that place nodes in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wsnsim.base.arrays import Bools, Floats


@dataclass(frozen=True, slots=True)
class Field:
    """The monitored rectangle.

    Attributes:
        width: along x, in m.
        height: along y, in m.
        centre: (x, y) in m.
    """

    width: float
    height: float
    centre: tuple[float, float] = (0.0, 0.0)

    def contains(self, points: Floats) -> Bools:
        """(N,) whether each of the (N, 2) points lies in the field, its edge included."""
        half = np.array([self.width, self.height]) / 2
        inside: Bools = np.all(np.abs(points - np.array(self.centre)) <= half, axis=-1)
        return inside


class Deployment(Protocol):
    """Where the nodes stand."""

    @property
    def field(self) -> Field:
        """The monitored rectangle, in which nodes stand."""

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in m.

        Args:
            reach: The sensing range in m, with which nodes cover the field if the component requires it.
            rng: The source of random numbers.

        Raises:
            RunError: The nodes do not cover the field, after many attempts.
        """
