"""Mean and covariance in a head: fusion of what arrived, prediction by the motion model, and operations of both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.ports import MotionModel, Scene
from wsnsim.base.setups import TrackingSetup

LINEARISE_CYCLES = 20.0
"""CPU cycles to compute what is expected of one reading at one point, with its slope and variance."""
LEAST_VARIANCE = 1e-9
LEAST_EIGENVALUE = 1e-9
"""Of the process noise as a correlation matrix, below which its inverse is not used (our choice)."""


def predicted(mean: Floats, cov: Floats, scene: Scene) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) at `scene.time`, by the motion model that the filter assumes: f(x), F P Fᵀ + Q.

    Args:
        mean: (D,) one step ago, or `scene.steps` steps ago.
        cov: (D, D) then.
        scene: What the head knows.
    """
    return stepped(mean, cov, scene.motion, scene.dt, scene.since, scene.steps)


def forecast(estimate: Estimate, scene: Scene, ahead: int) -> Estimate:
    """An estimate, predicted by the motion model that the filter assumes.

    Args:
        estimate: That of `scene.time`.
        scene: What the head knows.
        ahead: The number of steps.
    """
    now = scene.step * scene.dt
    moved = stepped(estimate.mean, estimate.cov, scene.motion, scene.dt, now, ahead)
    return Estimate(*moved, estimate.effective)


def stepped(
    mean: Floats, cov: Floats, motion: MotionModel, dt: float, time: float, steps: int = 1
) -> tuple[Floats, Floats]:
    """Mean and covariance `steps` steps of `dt` after `time`, by a motion model."""
    for step in range(steps):
        point, now = np.ascontiguousarray(mean[:, None]), time + step * dt
        transitions, noise = motion.matrices(point, dt, now)
        mean = motion.advance(point, dt, now)[:, 0]
        cov = symmetric(transitions[0] @ cov @ transitions[0].T + noise)
    return mean, cov


def symmetric(cov: Floats) -> Floats:
    """The symmetric part (..., D, D) of square matrices, without what rounding left.

    Args:
        cov: (..., D, D).
    """
    return 0.5 * (cov + cov.swapaxes(-1, -2))


def mixed(weights: Floats, means: Floats, covs: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a mixture of Gaussians (K, D), (K, D, D), whose weights (K,) have the sum 1."""
    mean = weights @ means
    around = means - mean
    return mean, symmetric(np.einsum("k,kij->ij", weights, covs) + (around.T * weights) @ around)


def fused_by_variance(means: Floats, variances: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean (D,) of local means, each column weighed by its inverse variances; their spread and a covariance (D, D).

    The last is the covariance of such a mean if the local errors were independent, which they are not quite.

    Args:
        means: (M, D) of M members.
        variances: (M, D) of each column.
    """
    precisions = 1.0 / np.maximum(variances, LEAST_VARIANCE)
    weights = precisions / precisions.sum(axis=0)
    mean = (weights * means).sum(axis=0)
    around = np.sqrt(weights) * (means - mean)
    return mean, around.T @ around, np.diag(1.0 / precisions.sum(axis=0))


def noise_issues(setup: TrackingSetup, why: str) -> Iterator[Issue]:
    """An issue for each filter's motion model whose process noise has no inverse, which `why` needs."""
    for number, motion in enumerate(setup.filter_motions):
        _, noise = motion.matrices(np.zeros((len(motion.columns), 1)), setup.dt, 0.0)
        sd = np.sqrt(np.diag(noise))
        if not (sd > 0.0).all() or np.linalg.eigvalsh(noise / np.outer(sd, sd))[0] < LEAST_EIGENVALUE:
            path = ("motion",) if len(setup.filter_motions) == 1 else ("targets", number)
            remedy = "take a noise that acts on every column (see the motion's `noise` or `noise_input`)"
            yield Issue(path, f"the process noise is singular, and {why} needs its density: {remedy}")


def prediction_cycles(size: int) -> float:
    """Operations of one step x⁻ = f(x), P⁻ = F P Fᵀ + Q of a state of so many columns."""
    return 4.0 * size**3 + 2.0 * size**2


def update_cycles(size: int, place: int) -> float:
    """Operations by which one linearised reading updates a state of `size` columns, `place` of them the position."""
    innovation = 4.0 * place + 2.0 * place * size + LINEARISE_CYCLES  # ν, S = H P⁻ Hᵀ + R
    update = 3.0 * size + 8.0 * size**2  # x⁺ = x⁻ + G ν; P⁺ in Joseph's form
    return innovation + update


def is_definite(cov: Floats) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        return False
    return True
