"""The cubature Kalman filter in one head: the third-degree spherical-radial rule.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from typing import ClassVar

from wsnsim.base.part import part
from wsnsim.trackers.shared.sigma_points import SigmaPointFilter, Weights


@part
class CubatureKalman(SigmaPointFilter):
    """Cubature Kalman filter on all readings that reach the head.

    2 D points of equal weight, √D columns of the covariance's Cholesky factor away from the mean, integrate polynomials
    up to the third degree exactly. The mean itself has no weight: it is what angles are averaged relative to, and where
    the variances of the readings are taken, as in `ekf`.

    Source: Arasaratnam, Haykin (2009).
    """

    linear_gaussian: ClassVar[bool] = True

    def weights(self, size: int) -> Weights:
        """The rule for a state of `size` columns."""
        return Weights(math.sqrt(size), 0.5 / size, 0.0)
