"""What a tracker reports for a step: an estimate, and the innovation of its update."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wsnsim.base.arrays import Floats


class Innovation(NamedTuple):
    """The normalised innovation squared νᵀ S⁻¹ ν of an update (NaN without one), and its degrees of freedom."""

    nis: float = float("nan")
    dof: int = 0


NO_INNOVATION = Innovation()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A Gaussian summary of a belief: mean (D,), cov (D, D).

    Filters with particles add their effective number, Kalman filters the innovation of the step's update.
    """

    mean: Floats
    cov: Floats
    effective: float = float("nan")
    innovation: Innovation = NO_INNOVATION
