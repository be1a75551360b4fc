"""What a tracker reports for a step: an estimate, and the innovation of its update."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wsnsim.base.arrays import Floats


class Innovation(NamedTuple):
    """The innovation ν of an update, normalised by its covariance S.

    Attributes:
        nis: the normalised innovation squared νᵀ S⁻¹ ν; NaN without one.
        dof: its degrees of freedom.
    """

    nis: float = float("nan")
    dof: int = 0


NO_INNOVATION = Innovation()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A Gaussian summary of a belief.

    Attributes:
        mean: (D,) of the state, in SI units.
        cov: (D, D) its covariance.
        effective: the effective number of particles; NaN for filters without particles.
        innovation: that of the step's update, for Kalman filters.
    """

    mean: Floats
    cov: Floats
    effective: float = float("nan")
    innovation: Innovation = NO_INNOVATION
