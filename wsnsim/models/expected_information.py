"""The expected information of readings that have not been taken: how much each node would add.

    seen = ExpectedInformation.along(outlook, path)      seen.spread(chosen)

The Fisher information of a reading about the position is that at the predicted position; nodes that would have no
reading there have none (`base.sensing`). What is compared is the trace of the inverse (A-optimality): the
mean square error of the position that the readings of one step leave. Source: Bar-Shalom, Li, Kirubarajan (2001),
section 2.7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, planar
from wsnsim.base.clustering import NearNodes, Outlook
from wsnsim.base.sensing import detected, informations

PRIOR: Final = 4.0
"""Over the squared sensing range: the information of being somewhere in a disc of that radius, along each axis."""


@dataclass(frozen=True, slots=True)
class ExpectedInformation:
    """The nodes that would have a reading of a target somewhere on its path, and the information in their readings.

    Attributes:
        near: the n nodes.
        information: (n, K, P, P) Fisher information of one reading of each node, at each of the K positions.
        prior: information along each axis that is added to every sum, so that it has an inverse.
    """

    near: NearNodes
    information: Floats
    prior: float

    @classmethod
    def along(cls, outlook: Outlook, path: Floats) -> ExpectedInformation:
        """The information of all nodes about a target at each of the positions of its path (K, P)."""
        reach, points = float(outlook.sensor.reach), planar(path)
        centre = points.mean(axis=0)
        farthest = float(np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
        near = outlook.nodes_near(centre, reach + farthest)
        return cls(near, _information(outlook.sensor, path, near), PRIOR / reach**2)

    def spread(self, chosen: Floats | Bools) -> Floats:
        """(C, K) in m² the mean square error that readings leave, at each position.

        Args:
            chosen: (C, n) whether each node's reading counts, in each of C choices.
        """
        shape = self.information.shape
        total = chosen.astype(np.float64) @ self.information.reshape(shape[0], math.prod(shape[1:]))
        return _trace_of_inverse(total.reshape(-1, *shape[1:]), self.prior)


def _trace_of_inverse(total: Floats, prior: float) -> Floats:
    """(...) the trace of (A + prior I)⁻¹ of symmetric matrices A (..., P, P), P being 1 or 2."""
    first = total[..., 0, 0] + prior
    if total.shape[-1] == 1:
        inverse: Floats = 1.0 / first
        return inverse
    second = total[..., 1, 1] + prior
    trace: Floats = (first + second) / (first * second - total[..., 0, 1] ** 2)
    return trace


def _information(sensor: Any, path: Floats, near: NearNodes) -> Floats:
    """(n, K, P, P) Fisher information of one reading of each node; a reading may have several components."""
    positions, columns = path.shape
    if not near.ids.size:
        return np.zeros((0, positions, columns, columns))
    found = np.moveaxis(informations(sensor, np.ascontiguousarray(path.T), near.positions, near.traits), 3, 1)
    sensed = detected(sensor, path, near.positions).T & np.isfinite(found).all(axis=(2, 3))
    return np.where(sensed[:, :, None, None], found, 0.0)
