"""The unscented Kalman filter in one head: sigma points with the scaled unscented transform.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.sigma_points import SigmaPointFilter, Weights

LEAST_ROOM: Final = 1e-7
"""Least D + λ. With points that are nearer to the mean, rounding errors change the estimates by a per cent and more."""


@part
class UnscentedKalman(SigmaPointFilter):
    """Unscented Kalman filter on all readings that reach the head, with additive noise.

    λ = α² (D + κ) - D; the points are √(D + λ) columns of the covariance's Cholesky factor away from the mean and have
    the weight 1 / (2 (D + λ)); the central one has λ / (D + λ) in means, and 1 - α² + β more in covariances. Points are
    drawn again after the prediction. The variance of a reading is that at the predicted mean, as in `ekf`.

    With the default values no weight of a covariance is negative (our choice; α = 1 and β = κ = 0 is `ckf`). Where a
    negative weight of the central point would make a covariance indefinite, its term is left out, as in the modified
    form of the transform about the central point.

    Source: Julier, Uhlmann (2004); Wan, van der Merwe (2000) for α, β and κ.
    """

    linear_gaussian: ClassVar[bool] = True

    alpha: Annotated[float, Quantity("", ge=1e-3, le=1), "α: spread of the sigma points"] = 1.0
    beta: Annotated[float, Quantity("", ge=-1e3, le=1e3), "β: prior knowledge of the distribution; 2: Gaussian"] = 2.0
    kappa: Annotated[float, Quantity("", ge=-1e3, le=1e3), "κ: secondary scaling, above -D for D columns"] = 0.0

    def weights(self, size: int) -> Weights:
        """The rule for a state of `size` columns. Raises ValueError if κ makes D + λ negative or nearly zero."""
        room = self.alpha**2 * (size + self.kappa)  # D + λ
        if not size + self.kappa > 0.0:
            raise ValueError(f"kappa: {self.kappa:g} must be greater than -{size}, for a state of {size} columns")
        if room < LEAST_ROOM:
            raise ValueError(
                f"kappa: alpha² (columns + kappa) is {room:.3g} for a state of {size} columns, must be at least "
                f"{LEAST_ROOM:g}: nearer sigma points lose digits"
            )
        return Weights(math.sqrt(room), 0.5 / room, 1.0 - size / room + 1.0 - self.alpha**2 + self.beta)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the state has too few columns for κ."""
        for size in sorted({len(motion.columns) for motion in setup.filter_motions}):
            try:
                self.weights(size)
            except ValueError as error:
                yield Issue(("tracker", "kappa"), str(error).removeprefix("kappa: "))
