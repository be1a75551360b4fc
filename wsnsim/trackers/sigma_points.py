"""The unscented and the cubature Kalman filter in one head, which pass sigma points through the models.

    points(mean (D,), cov (D, D), weights) -> (D, 2 D + 1), the mean first: the central point

The points are the mean m itself and m ± √(D + λ) times each column of the lower Cholesky factor of the covariance. The
models transform them; then the differences from the transformed central point are averaged. So angles are averaged
correctly, and large weights of opposite signs do not cancel.

The update needs no matrix of the size of the readings: with the deviations X (D, 2 D) and Z (S, 2 D) of the points,
times the roots of their weights, P⁺ = X (I + Zᵀ R⁻¹ Z)⁻¹ Xᵀ, which is positive semi-definite however sharp the readings
are. It equals P - P_xz S⁻¹ P_xzᵀ with S = Z Zᵀ + R. The central point adds a term of rank one to S.
Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import NO_INNOVATION, Estimate, Floats, Innovation, innovation_of, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import MotionModel, Scene, SensorModel, Trigger
from wsnsim.base.requests import Compute, Flow
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.gaussian import cholesky
from wsnsim.trackers.shared.gaussian_port import GaussianBank, LinearisedPort, joined
from wsnsim.trackers.shared.heads import GaussianBelief, LateFilter
from wsnsim.trackers.shared.moments import LINEARISE_CYCLES, is_definite, symmetric
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.triggers import Always, trigger_issues


class Weights(NamedTuple):
    """The distance and the weights of the sigma points for a state of D columns.

    Attributes:
        scale: √(D + λ), by which the columns of the Cholesky factor are multiplied.
        each: The weight of each point but the central one: 1 / (2 (D + λ)).
        centre: The weight of the central point in covariances. In means it is 1 minus the sum of the others.
    """

    scale: float
    each: float
    centre: float


@part
class SigmaPointFilter(LateFilter):
    """A sigma-point Kalman filter in the head, on all readings that reach it. A subclass gives `weights`."""

    tells_prediction: ClassVar[bool] = True
    assumes_gaussian: ClassVar[bool] = True
    retrodicts: ClassVar[bool] = True

    trigger: Annotated[Trigger, OfRole("trigger"), "when a member sends its reading"] = Always()

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if members cannot decide by their readings."""
        yield from trigger_issues(self, setup)

    def weights(self, size: int) -> Weights:
        """The rule for a state of `size` columns."""
        raise NotImplementedError

    def one_step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head; it predicts, and updates with what arrived."""
        heard = yield from self.trigger.gather(belief, scene)
        seen = heard.seen
        yield Compute(_cycles(belief.mean.size, seen.readings.size, scene.steps))
        weights, innovation = self.weights(belief.mean.size), NO_INNOVATION
        mean, cov = _stepped(belief.mean, belief.cov, weights, scene, scene.since, scene.steps)
        if seen.ids:
            mean, cov, innovation = updated(mean, cov, weights, seen, scene)
        mean, cov = heard.with_silence(mean, cov, scene)
        return GaussianBelief(mean, cov, scene.head, innovation=innovation, shared=heard.shared)

    def gaussian(self, motion: MotionModel) -> SigmaPointPort:
        """The filter for trackers of several targets."""
        return SigmaPointPort(motion, self.weights(len(motion.columns)))

    def forecast(self, belief: GaussianBelief, scene: Scene, ahead: int) -> Estimate:
        """The estimate `ahead` steps later, predicted by sigma points."""
        now, weights = scene.step * scene.dt, self.weights(belief.mean.size)
        return Estimate(*_stepped(belief.mean, belief.cov, weights, scene, now, ahead))


class SigmaPointPort(LinearisedPort):
    """A sigma-point filter for trackers of several targets."""

    def __init__(self, motion: MotionModel, weights: Weights) -> None:
        super().__init__(motion)
        self._weights = weights

    def predicted(self, bank: GaussianBank, dt: float, time: float) -> GaussianBank:
        """The bank one step later."""
        each = zip(bank.means[:, 0], bank.covs[:, 0], strict=True)
        moved = [predicted(mean, cov, self._weights, self._motion, dt, time) for mean, cov in each]
        means, covs = (np.array([one[part] for one in moved]) for part in (0, 1))
        return GaussianBank(means[:, None], covs[:, None], bank.chances)

    def joint(
        self, bank: GaussianBank, sensor: SensorModel, positions: Floats, traits: Floats
    ) -> tuple[Floats, Floats]:
        """Joint moments of states and readings; the variances of readings are those at the means."""
        weights, means, covs = self._weights, bank.means[:, 0], bank.covs[:, 0]
        clouds = np.stack([points(mean, cov, weights) for mean, cov in zip(means, covs, strict=True)])
        count, _, number = clouds.shape
        flat = clouds[:, list(self._motion.position)].transpose(1, 0, 2).reshape(-1, count * number)
        linear = sensor.linearise(np.ascontiguousarray(flat), positions, traits)
        expected = linear[0].reshape(-1, count, number).transpose(1, 0, 2)
        expected = np.stack([near(sensor, each, each[:, :1]) for each in expected])
        centre = expected[:, :, 0]
        mids = centre + weights.each * (expected[:, :, 1:] - centre[:, :, None]).sum(axis=2)
        around = expected[:, :, 1:] - mids[:, :, None]
        cross = weights.each * around @ (clouds[:, :, 1:] - means[:, :, None]).transpose(0, 2, 1)
        widths = weights.each * around @ around.transpose(0, 2, 1)
        rows, noise = np.arange(mids.shape[1]), linear[2].reshape(-1, count, number)[:, :, 0].T
        widths[:, rows, rows] += noise
        whole = joined(covs, cross, widths)
        deviations = np.concatenate([np.zeros(means.shape), centre - mids], axis=1)
        covs = np.stack([_with_centre(*each, weights.centre) for each in zip(whole, deviations, strict=True)])
        return np.concatenate([means, mids], axis=1), covs


def points(mean: Floats, cov: Floats, weights: Weights) -> Floats:
    """The sigma points (D, 2 D + 1) of a Gaussian: its mean, then those with +, then those with -."""
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

    The variances R of the readings are those at the predicted mean. A reading is left out if it, or its expected
    value at one of the points, is not finite.
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
    central, scaled = (centre - mid)[known] * inverse, innovation[known] * inverse
    deviations = root * (cloud[:, 1:] - mean[:, None])
    shift, after, square = _conditioned(deviations, white, central, scaled, weights.centre)
    return mean + shift, after, innovation_of(scene.sensor, square, int(np.count_nonzero(known)))


def _conditioned(
    deviations: Floats, white: Floats, central: Floats, innovation: Floats, weight: float
) -> tuple[Floats, Floats, float]:
    """The shift (D,) of the mean, the covariance (D, D) after the update and νᵀ S⁻¹ ν.

    Args:
        deviations: X (D, n), those of all points but the central one, times the roots of their weights.
        white: Z (S, n), the deviations of their expected readings, likewise, in standard deviations of the readings.
        central: (S,) z₀, the deviation of the central point's expected reading, in standard deviations.
        innovation: (S,) ν, in standard deviations.
        weight: The weight of the central point.
    """
    projected = white.T @ np.column_stack([innovation, central])
    right_sides = np.concatenate([projected, deviations.T], axis=1)
    solved = np.linalg.solve(np.eye(white.shape[1]) + white.T @ white, right_sides)  # (I + Zᵀ R⁻¹ Z)⁻¹ ...
    shift, gain, cov = deviations @ solved[:, 0], deviations @ solved[:, 1], symmetric(deviations @ solved[:, 2:])
    # without the central point: νᵀ S⁻¹ ν by the matrix inversion lemma
    square = float(innovation @ innovation - projected[:, 0] @ solved[:, 0])
    # with its weight w, S + w z₀ z₀ᵀ takes the place of S (Sherman-Morrison): z₀ᵀ S⁻¹ ν, and 1 + w z₀ᵀ S⁻¹ z₀
    central_innovation = float(central @ innovation - projected[:, 1] @ solved[:, 0])
    ratio = 1.0 + weight * float(central @ central - projected[:, 1] @ solved[:, 1])
    if weight == 0.0 or not ratio > 0.0:
        return shift, cov, square
    share = weight / ratio
    after = cov + share * np.outer(gain, gain)
    if share < 0.0 and not is_definite(after):
        return shift, cov, square
    return shift - share * central_innovation * gain, after, square - share * central_innovation**2


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
    """Operations of a prediction over `steps` with n = 2 D points about the mean, and of an update with `readings`."""
    n = 2.0 * size
    sigma_points = size**3 / 3.0 + 2.0 * n * size  # the Cholesky factor and the points
    prediction = sigma_points + 2.0 * (n + 1.0) * size**2 + 2.0 * n * size**2  # f of each, mean and covariance
    per_reading = (n + 1.0) * (LINEARISE_CYCLES + 2.0) + 2.0 * n * (n + 2.0)  # h, its mean; Zᵀ R⁻¹ (Z, ν, z₀)
    solution = 2.0 * n**3 / 3.0 + 2.0 * n**2 * (size + 2.0) + 2.0 * size * n * (size + 2.0)
    return steps * prediction + (sigma_points + readings * per_reading + solution if readings else 0.0)


LEAST_ROOM: Final = 1e-7
"""Least D + λ. With points that are nearer to the mean, rounding errors change the estimates by a per cent and more."""


@part
class UnscentedKalman(SigmaPointFilter):
    """Unscented Kalman filter on all readings that reach the head, with additive noise.

    λ = α² (D + κ) - D; the points are √(D + λ) columns of the covariance's Cholesky factor away from the mean and have
    the weight 1 / (2 (D + λ)); the central one has λ / (D + λ) in means, and 1 - α² + β more in covariances. Points are
    computed again after the prediction. The variance of a reading is that at the predicted mean, as in `ekf`.

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
        """Yield an issue if the state has too few columns for κ, or members cannot decide by their readings."""
        yield from super().check(setup)
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
