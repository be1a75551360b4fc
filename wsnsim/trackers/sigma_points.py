"""The unscented and the cubature Kalman filter in one head, which pass sigma points through the models.

    points(mean (D,), cov (D, D), weights) -> (D, 2 D + 1), the mean first: the central point

A point ±√(D + λ) along each column of the lower Cholesky factor of the covariance, and the mean itself. What is made
of them is averaged relative to what is made of the central point: an angle by its difference from that of the central
point, and a large weight of opposite sign cancels nothing.

The update needs no matrix of the size of the readings: with the deviations X (D, 2 D) and Z (S, 2 D) of the points,
times the roots of their weights, P⁺ = X (I + Zᵀ R⁻¹ Z)⁻¹ Xᵀ, which is positive semi-definite however sharp the readings
are. It equals P - P_xz S⁻¹ P_xzᵀ with S = Z Zᵀ + R, and the term of the central point is added as one of rank one.
Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import NO_INNOVATION, Estimate, Floats, Innovation, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import MotionModel, Scene
from wsnsim.base.requests import Compute, Flow
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.gaussian import cholesky
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.kalman import LINEARISE_CYCLES, KalmanBelief, is_definite, kalman_estimate
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings


class Weights(NamedTuple):
    """What a rule says of its points, of a state of D columns.

    Attributes:
        scale: √(D + λ), the distance of the points from the mean, in columns of the Cholesky factor.
        each: The weight of each point but the central one: 1 / (2 (D + λ)).
        centre: The weight of the central point in covariances. In means, weights add up to 1.
    """

    scale: float
    each: float
    centre: float


@part
class SigmaPointFilter(HeadFilter):
    """A Kalman filter of sigma points in the head, on all readings that reach it. A tracker gives `weights`."""

    def weights(self, size: int) -> Weights:
        """The rule for a state of `size` columns."""
        raise NotImplementedError

    def step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head; it predicts, and updates with what arrived."""
        seen = yield from gather_readings(scene)
        yield Compute(_cycles(belief.mean.size, seen.readings.size, scene.steps))
        weights, innovation = self.weights(belief.mean.size), NO_INNOVATION
        mean, cov = _stepped(belief.mean, belief.cov, weights, scene, scene.since, scene.steps)
        if seen.ids:
            mean, cov, innovation = updated(mean, cov, weights, seen, scene)
        return KalmanBelief(mean, cov, scene.head, innovation=innovation)

    def estimate(self, belief: GaussianBelief) -> Estimate:
        """The belief's mean and covariance, with the innovation of the step; after a handover there is none yet."""
        return kalman_estimate(belief)

    def forecast(self, belief: GaussianBelief, scene: Scene, ahead: int) -> Estimate:
        """The estimate `ahead` steps on, predicted by sigma points."""
        now, weights = scene.step * scene.dt, self.weights(belief.mean.size)
        return Estimate(*_stepped(belief.mean, belief.cov, weights, scene, now, ahead))


def points(mean: Floats, cov: Floats, weights: Weights) -> Floats:
    """The sigma points (D, 2 D + 1) of a Gaussian: its mean, then those above it, then those below."""
    root = np.zeros(cov.shape)
    cholesky(np.ascontiguousarray(cov), root)
    apart, centre = weights.scale * root, mean[:, None]
    return np.concatenate([centre, centre + apart, centre - apart], axis=1)


def predicted(
    mean: Floats, cov: Floats, weights: Weights, motion: MotionModel, dt: float, time: float
) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) one step later. The process noise is that at the mean."""
    moved = motion.advance(points(mean, cov, weights), dt, time)
    _, noise = motion.matrices(np.ascontiguousarray(mean[:, None]), dt, time)
    centre, others = moved[:, 0], moved[:, 1:]
    after = centre + weights.each * (others - centre[:, None]).sum(axis=1)
    around = others - after[:, None]
    spread = symmetric(weights.each * (around @ around.T) + noise)
    return after, _with_centre(spread, centre - after, weights.centre)


def updated(
    mean: Floats, cov: Floats, weights: Weights, seen: Evidence, scene: Scene
) -> tuple[Floats, Floats, Innovation]:
    """Mean (D,) and covariance (D, D) updated with readings, and the innovation.

    The variances R of the readings are those at the predicted mean. A reading is left out if it is not finite, or what
    is expected of it at a point is not.
    """
    cloud = points(mean, cov, weights)
    linear = scene.sensor.linearise(cloud[list(scene.motion.position)], seen.positions, seen.traits)
    expected, variances = near(scene.sensor, linear[0], linear[0][:, :1]), linear[2][:, 0]
    centre = expected[:, 0]
    mid = centre + weights.each * (expected[:, 1:] - centre[:, None]).sum(axis=1)
    innovation = near(scene.sensor, rows(scene.sensor, seen.readings), mid) - mid
    known = np.isfinite(innovation) & np.isfinite(expected).all(axis=1) & (variances > 0.0) & (variances < np.inf)
    if not known.any():
        return mean, cov, NO_INNOVATION
    inverse = 1.0 / np.sqrt(variances[known])
    root = np.sqrt(weights.each)
    white = (expected[known, 1:] - mid[known, None]) * (root * inverse[:, None])  # R^-1/2 Z
    first, behind = (centre - mid)[known] * inverse, innovation[known] * inverse
    apart = root * (cloud[:, 1:] - mean[:, None])
    after, spread, square = _conditioned(apart, white, first, behind, weights.centre)
    return mean + after, spread, Innovation(square, int(np.count_nonzero(known)))


def _conditioned(
    apart: Floats, white: Floats, first: Floats, behind: Floats, weight: float
) -> tuple[Floats, Floats, float]:
    """The shift (D,) of the mean, the covariance (D, D) after the update and νᵀ S⁻¹ ν.

    Args:
        apart: X (D, n), the deviations of the points but the central one, times the roots of their weights.
        white: Z (S, n) of them, in standard deviations of the readings, as are the next two.
        first: (S,) the deviation of the central point.
        behind: (S,) the innovation ν.
        weight: The weight of the central point.
    """
    lifted = white.T @ np.column_stack([behind, first])
    sides = np.concatenate([lifted, apart.T], axis=1)
    solved = np.linalg.solve(np.eye(white.shape[1]) + white.T @ white, sides)  # (I + Zᵀ R⁻¹ Z)⁻¹ ...
    shift, lift, cov = apart @ solved[:, 0], apart @ solved[:, 1], symmetric(apart @ solved[:, 2:])
    square = float(behind @ behind - lifted[:, 0] @ solved[:, 0])
    along = float(first @ behind - lifted[:, 1] @ solved[:, 0])
    width = 1.0 + weight * float(first @ first - lifted[:, 1] @ solved[:, 1])
    if weight == 0.0 or not width > 0.0:
        return shift, cov, square
    share = weight / width
    after = cov + share * np.outer(lift, lift)
    if share < 0.0 and not is_definite(after):
        return shift, cov, square
    return shift - share * along * lift, after, square - share * along**2


def _with_centre(cov: Floats, deviation: Floats, weight: float) -> Floats:
    """The covariance with the term of the central point, unless a negative weight would make it indefinite."""
    if weight == 0.0:
        return cov
    whole: Floats = cov + weight * np.outer(deviation, deviation)
    return whole if weight > 0.0 or is_definite(whole) else cov


def _stepped(
    mean: Floats, cov: Floats, weights: Weights, scene: Scene, time: float, steps: int
) -> tuple[Floats, Floats]:
    for step in range(steps):
        mean, cov = predicted(mean, cov, weights, scene.motion, scene.dt, time + step * scene.dt)
    return mean, cov


def _cycles(size: int, readings: int, steps: int) -> float:
    """Operations of a step with n = 2 D points about the mean, and of the update with as many readings."""
    n = 2.0 * size
    drawn = size**3 / 3.0 + 2.0 * n * size  # the Cholesky factor and the points
    prediction = drawn + 2.0 * (n + 1.0) * size**2 + 2.0 * n * size**2  # f of each, mean and covariance
    a_reading = (n + 1.0) * (LINEARISE_CYCLES + 2.0) + 2.0 * n * (n + 2.0)  # h, its mean; Zᵀ R⁻¹ (Z, ν, z₀)
    solution = 2.0 * n**3 / 3.0 + 2.0 * n**2 * (size + 2.0) + 2.0 * size * n * (size + 2.0)
    return steps * prediction + (drawn + readings * a_reading + solution if readings else 0.0)


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
