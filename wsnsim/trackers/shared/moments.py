"""What a head says of a target in two moments: what arrived, fused, and what the motion model makes of it later."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Fault
from wsnsim.base.ports import Estimate, MotionModel, Parts

LEAST_VARIANCE = 1e-9
LEAST_EIGENVALUE = 1e-9
"""Of the process noise as a correlation matrix, below which its inverse is not used (our choice)."""


def predicted(mean: Floats, cov: Floats, motion: MotionModel, dt: float, steps: int) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) `steps` steps on: the motion without noise, and F P Fᵀ + Q at the mean."""
    for _ in range(steps):
        point = np.ascontiguousarray(mean[:, None])
        transitions, noise = motion.matrices(point, dt)
        mean = motion.advance(point, dt)[:, 0]
        cov = symmetric(transitions[0] @ cov @ transitions[0].T + noise)
    return mean, cov


def forecast(estimate: Estimate, motion: MotionModel, dt: float, ahead: int) -> Estimate:
    """An estimate `ahead` steps on."""
    return Estimate(*predicted(estimate.mean, estimate.cov, motion, dt, ahead), estimate.effective)


def symmetric(cov: Floats) -> Floats:
    """The symmetric part of a square matrix."""
    return 0.5 * (cov + cov.T)


def fused_by_variance(means: Floats, variances: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean (D,) of local means (M, D), each column weighed by its inverse variances (M, D); spread and cov (D, D).

    The last is the covariance of such a mean if the local errors were independent, which they are not quite.
    """
    precisions = 1.0 / np.maximum(variances, LEAST_VARIANCE)
    weights = precisions / precisions.sum(axis=0)
    mean = (weights * means).sum(axis=0)
    around = np.sqrt(weights) * (means - mean)
    return mean, around.T @ around, np.diag(1.0 / precisions.sum(axis=0))


def noise_faults(parts: Parts, why: str) -> Iterator[Fault]:
    """A fault for each filter's motion model whose process noise has no inverse, which `why` needs."""
    for number, motion in enumerate(parts.filter_motions):
        _, noise = motion.matrices(np.zeros((len(motion.columns), 1)), parts.dt)
        if _is_singular(noise):
            path = ("motion", "noise") if len(parts.filter_motions) == 1 else ("targets", number, "noise")
            yield Fault(path, f"the process noise is singular, and {why} needs its density")


def _is_singular(noise: Floats) -> bool:
    spread = np.sqrt(np.diag(noise))
    if not np.all(spread > 0):
        return True
    return bool(np.linalg.eigvalsh(noise / np.outer(spread, spread))[0] < LEAST_EIGENVALUE)
