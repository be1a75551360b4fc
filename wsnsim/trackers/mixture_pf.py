"""Cluster: a Rao-Blackwellised particle filter, with particles for the target's turns and Kalman filters for its state.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, Ints
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Parcel, Send
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.fixes import OfRanges, fix_cycles, fixed, usable
from wsnsim.trackers.shared.moments import mixed, symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings

COLUMNS: Final = ("px", "vx", "py", "vy")
MOVING: Final = np.array([1, 3])
Updates: TypeAlias = tuple[Floats, Floats, Floats]
"""Means (K, 4), covariances (K, 4, 4) and log-likelihoods (K,) after one measurement of all filters.

Where it is so much sharper than the prediction, or than another axis of its own, that a difference of covariances would
keep none of their digits, Joseph's form takes its place (Bucy, Joseph 1968): a sum of squares of roots, one axis of the
measurement after the other.
"""
PLACE: Final = np.array([0, 2])
"""The columns of the position."""
SHARP: Final = 1e-14
"""A variance below this share of another is lost beside it: a number has 16 digits."""
ROUNDING: Final = float(np.finfo(np.float64).eps)
ENOUGH_RANGES: Final = 3
"""Least number of ranges for a fix; with fewer, each range updates the filters on its own."""
UNKNOWN: Final = 1e6
"""Standard deviation (m) of a fix along an axis that the ranges do not determine. There it repeats the prediction."""
MOMENTS_BITS: Final = 800
"""100 bytes: a mean and a covariance."""
LEAST_FIXES: Final = 4
"""Least number of fixes for a prediction (Li 2012, initial acquisition and reacquisition)."""
TURN, RESAMPLE = 1, 2
"""Purposes of the random numbers of a head at a step."""
PREDICT_CYCLES: Final = 45.0
"""Operations per particle: to sample its mode 3, and to keep its course: the mean 4, F P Fᵀ row by row 32, its noise 6.

A turn costs less. Equal particles are counted each, though stored once. Weighted as in `shared.fixes`."""
FIX_CYCLES: Final = 126.0
"""Operations per particle for an update with a fix: innovation and its covariance 5, the inverse 9, gain 24, mean 16,
covariance 40, log-weight 32."""
COVARIANCE_CYCLES: Final = (60.0, 33.0)
"""Operations of a fix's covariance, and per range: direction and variance 18, sums 15."""
RANGE_CYCLES: Final = 92.0
"""Operations per particle and range: innovation and gradient 16, its variance 16, gain 7, mean 8, covariance 20,
log-weight 25."""
MIX_CYCLES: Final = 82.0
"""Operations per particle: weight 25, effective number 2, mean 8, covariance 44, resampling 3."""


@dataclass(frozen=True, slots=True)
class Mixture:
    """K different Kalman filters with `means` (K, 4) and `covs` (K, 4, 4), shared by `counts` (K,) particles each.

    `log_weights` (K,) are those of one particle. `mean` and `cov` are those of the whole mixture. `fixes` is the
    number of steps at which the target was sensed since the track began, its start included.
    """

    means: Floats
    covs: Floats
    counts: Ints
    log_weights: Floats
    mean: Floats
    cov: Floats
    head: int
    fixes: int = 1
    effective: float = float("nan")


@part
class MixturePf(OfRanges):
    """A filter whose particles sample at each step whether the target turns, with probability 1 - exp(-dt/τ).

    Without a turn the target keeps near-constant velocity; with one it has a new velocity, N(0, turn_sd²) on each axis.
    Given its modes, a particle is a Kalman filter. It is updated with the least-squares fix of three or more ranges, or
    with each range, linearised, if there are fewer. Particles with the same history have the same filter. It is stored
    once, with their number, which saves computing time and changes no result.

    A handover carries mean and covariance in 100 bytes; all particles of the successor start from them.

    A reconstruction of Yang, Xing, Shi, Pan (2007), of which we know one sentence in Li, Jiang, Zhang, Zhang (2012);
    only the 1500 particles are theirs. The filter has its own motion model, independent of the scenario's. Particles
    are resampled if their effective number is below half of their number (our choice).
    """

    assumes_gaussian: ClassVar[bool] = True

    particles: Annotated[int, Quantity("", ge=1, le=1_000_000), "N_p: particles"] = 1500
    q: Annotated[float, Quantity("m2/s3", ge=0.0, le=1e9), "intensity of the noise in a kept velocity"] = 0.05
    turn_time: Annotated[float, Quantity("s", gt=0.0, le=1e9), "τ: mean time between turns"] = 60.0
    turn_sd: Annotated[float, Quantity("m/s", gt=0.0, le=1e6), "standard deviation of a new velocity, on each axis"] = (
        3.0
    )
    start_sd: Annotated[
        tuple[float, float, float, float],
        Quantity("", gt=0.0, le=1e7, label="SI"),
        "standard deviations of P0, in m and m/s",
    ] = (5.0, 3.0, 5.0, 3.0)
    reading_bits: Annotated[int, Quantity("", ge=1, le=100_000, label="bit"), "bits of a reading on the air"] = 88

    def start(self, prior: Estimate, scene: Scene) -> Flow[Mixture]:
        """The prior's mean with P0; the prior's covariance of the position replaces that of P0 if it is larger.

        That is our choice: after initiation from one range, the target may be anywhere on a circle. Raises RunError for
        a motion model with another state.
        """
        if scene.motion.columns != COLUMNS:
            raise RunError(_other_state(scene.motion.columns))
        cov, place = np.diag(np.array(self.start_sd) ** 2), np.ix_(PLACE, PLACE)
        if np.trace(prior.cov[place]) > np.trace(cov[place]):
            cov[place] = prior.cov[place]
        return self._collapsed(prior.mean, cov, scene.head, 1)
        yield  # a flow without requests

    def step(self, belief: Mixture, scene: Scene) -> Flow[Mixture]:
        """One step: N_act - 1 readings reach the head, which samples modes, predicts, updates and resamples."""
        seen = yield from gather_readings(scene, self.reading_bits)
        predicted = belief
        for number in range(scene.steps):
            predicted = self._predicted(predicted, scene, number)
        cycles = self.particles * PREDICT_CYCLES * scene.steps
        if not seen.ids:
            yield Compute(cycles)
            return self._summed(predicted, scene.head)
        updated, used = self._updated(replace(predicted, fixes=belief.fixes + 1), seen, scene)
        yield Compute(cycles + used + self.particles * MIX_CYCLES)
        return self._resampled(self._summed(updated, scene.head), scene)

    def hand_over(self, belief: Mixture, scene: Scene, successor: int) -> Flow[Mixture | None]:
        """Send the mixture's mean and covariance to the successor: 100 bytes."""
        mask = yield Send(successor, Parcel((belief.mean, belief.cov), 1, MOMENTS_BITS, "handover"))
        return self._collapsed(belief.mean, belief.cov, successor, belief.fixes) if mask.all() else None

    def forecast(self, belief: Mixture, scene: Scene, ahead: int) -> Estimate:
        """Mean and covariance of the mixture `ahead` steps later, turns included."""
        mean, cov = belief.mean, belief.cov
        for _ in range(ahead):
            mean, cov = self._moments_later(mean, cov, scene.dt)
        return Estimate(mean, cov, belief.effective)

    def belief_bits(self, belief: Mixture) -> int:
        """The size of a handover: 100 bytes."""
        return MOMENTS_BITS

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the state is not position and velocity in the plane."""
        for motion in setup.filter_motions:
            if motion.columns != COLUMNS:
                yield Issue(("tracker", "kind"), _other_state(motion.columns))
                return

    def turn_probability(self, dt: float) -> float:
        """The probability of a turn within dt s."""
        return -math.expm1(-dt / self.turn_time)

    def foresees(self, belief: Mixture) -> bool:
        """Whether the target was sensed at four steps, as in every protocol here: before, its velocity is unknown."""
        return belief.fixes >= LEAST_FIXES

    def _collapsed(self, mean: Floats, cov: Floats, head: int, fixes: int) -> Mixture:
        """A mixture of equal particles."""
        return Mixture(mean[None], cov[None], np.array([self.particles]), np.zeros(1), mean, cov, head, fixes)

    def _predicted(self, belief: Mixture, scene: Scene, number: int) -> Mixture:
        """The mixture one step later, after each particle sampled its mode."""
        key = derive(scene.key, TURN, number)
        drawn = uniforms(derive_all(key, np.arange(self.particles)), 0) < self.turn_probability(scene.dt)
        group = np.repeat(np.arange(belief.counts.size), belief.counts)
        turning = np.bincount(group[drawn], minlength=belief.counts.size)
        counts = np.concatenate([belief.counts - turning, turning])
        kept = kept_course(belief.means, belief.covs, scene.dt, self.q)
        turned = new_course(belief.means, belief.covs, scene.dt, self.turn_sd)
        means, covs = (np.concatenate(pair) for pair in zip(kept, turned, strict=True))
        alive = counts > 0
        log_weights = np.concatenate([belief.log_weights, belief.log_weights])[alive]
        return replace(belief, means=means[alive], covs=covs[alive], counts=counts[alive], log_weights=log_weights)

    def _updated(self, belief: Mixture, seen: Evidence, scene: Scene) -> tuple[Mixture, float]:
        """The mixture with all filters updated and weighted, and the number of operations."""
        ranged = usable(seen, scene)
        count = ranged.ranges.size
        if count >= ENOUGH_RANGES:
            start = self._summed(belief, scene.head).mean[PLACE]
            fix = fixed(ranged, start, UNKNOWN, scene)
            means, covs, scores = updated_by_fix(belief.means, belief.covs, fix.point, fix.cov)
            fixing = fix_cycles(count, fix.iterations) + COVARIANCE_CYCLES[0] + COVARIANCE_CYCLES[1] * count
            used = fixing + self.particles * FIX_CYCLES
        else:
            means, covs, scores = updated_by_readings(belief.means, belief.covs, seen, scene)
            used = self.particles * RANGE_CYCLES * len(seen.ids)
        return replace(belief, means=means, covs=covs, log_weights=belief.log_weights + scores), used

    def _summed(self, belief: Mixture, head: int) -> Mixture:
        """The mixture with its moments and its effective number of particles."""
        each = np.exp(belief.log_weights - belief.log_weights.max())
        weights = belief.counts * each
        effective = float(weights.sum() ** 2 / (weights * each).sum())
        weights = weights / weights.sum()
        mean, cov = mixed(weights, belief.means, belief.covs)
        return replace(belief, mean=mean, cov=cov, head=head, effective=effective)

    def _resampled(self, belief: Mixture, scene: Scene) -> Mixture:
        """The mixture, resampled systematically if the effective number is below half of the particles."""
        if belief.effective >= 0.5 * self.particles:
            return belief
        weights = belief.counts * np.exp(belief.log_weights - belief.log_weights.max())
        edges = np.cumsum(weights) / weights.sum()
        start = float(uniforms(np.array([derive(scene.key, RESAMPLE)], dtype=np.uint64), 0)[0])
        picks = np.searchsorted(edges, (np.arange(self.particles) + start) / self.particles, side="right")
        counts = np.bincount(np.minimum(picks, edges.size - 1), minlength=edges.size)
        alive = counts > 0
        return replace(
            belief, means=belief.means[alive], covs=belief.covs[alive], counts=counts[alive],
            log_weights=np.zeros(int(alive.sum())),
        )  # fmt: skip

    def _moments_later(self, mean: Floats, cov: Floats, dt: float) -> tuple[Floats, Floats]:
        """Mean and covariance of the mixture of both modes, one step later."""
        turn = self.turn_probability(dt)
        kept = kept_course(mean[None], cov[None], dt, self.q)
        turned = new_course(mean[None], cov[None], dt, self.turn_sd)
        means, covs = (np.concatenate(pair) for pair in zip(kept, turned, strict=True))
        return mixed(np.array([1.0 - turn, turn]), means, covs)


def _other_state(columns: tuple[str, ...]) -> str:
    return f"the tracker 'cluster' has the state {' '.join(COLUMNS)}; this motion's is {' '.join(columns)}"


def kept_course(means: Floats, covs: Floats, dt: float, q: float) -> tuple[Floats, Floats]:
    """Means (K, 4) and covariances (K, 4, 4) one step later, with near-constant velocity of noise intensity q."""
    axis = np.array([[1.0, dt], [0.0, 1.0]])
    noise = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    transition = np.kron(np.eye(2), axis)
    return means @ transition.T, transition @ covs @ transition.T + np.kron(np.eye(2), noise)


def new_course(means: Floats, covs: Floats, dt: float, sd: float) -> tuple[Floats, Floats]:
    """Means (K, 4) and covariances (K, 4, 4) after a step with a new velocity N(0, sd²) on each axis at its start."""
    later, spread, each, place = means.copy(), np.zeros_like(covs), np.arange(len(covs)), np.array(PLACE)
    later[:, MOVING] = 0.0
    for p, v in zip(PLACE, MOVING, strict=True):
        spread[:, p, v] = spread[:, v, p] = sd * sd * dt
        spread[:, v, v] = sd * sd
    spread[np.ix_(each, place, place)] = covs[:, PLACE][:, :, PLACE] + sd * sd * dt * dt * np.eye(2)
    return later, spread


def updated_by_fix(means: Floats, covs: Floats, point: Floats, noise: Floats) -> Updates:
    """After a fix (2,) of covariance (2, 2)."""
    values, axes = np.linalg.eigh(noise)
    if values[0] < SHARP * max(values[1], covs.max()):
        return _updated_by_axes(means, covs, point, np.maximum(values, ROUNDING * values[1]), axes)
    innovation = point - means[:, PLACE]
    spread = covs[:, PLACE][:, :, PLACE] + noise
    inverse = np.linalg.inv(spread)
    gain = covs[:, :, PLACE] @ inverse
    later = means + np.einsum("kij,kj->ki", gain, innovation)
    cov = covs - gain @ covs[:, PLACE, :]
    square = np.einsum("ki,kij,kj->k", innovation, inverse, innovation)
    return later, symmetric(cov), -0.5 * (square + np.log(np.linalg.det(spread)))


def updated_by_readings(means: Floats, covs: Floats, seen: Evidence, scene: Scene) -> Updates:
    """After one reading at a time, linearised."""
    scores = np.zeros(len(means))
    for i, reading in enumerate(seen.readings.tolist()):
        points = np.ascontiguousarray(means[:, PLACE].T)
        expected, gradients, variances = scene.sensor.linearise(
            points, seen.positions[i : i + 1], seen.traits[i : i + 1]
        )
        g = gradients[0].T
        cross = np.einsum("kij,kj->ki", covs[:, :, PLACE], g)
        told = np.einsum("ki,ki->k", g, cross[:, PLACE])
        innovation = reading - expected[0]
        if (variances[0] < SHARP * told).any():
            means, roots, more = _updated_along(means, _roots(covs), innovation, g, variances[0])
            covs, scores = roots @ roots.transpose(0, 2, 1), scores + more
            continue
        spread = told + variances[0]
        means = means + cross * (innovation / spread)[:, None]
        covs = covs - cross[:, :, None] * cross[:, None, :] / spread[:, None, None]
        scores = scores - 0.5 * (innovation**2 / spread + np.log(spread))
    return means, symmetric(covs), scores


def _updated_by_axes(means: Floats, covs: Floats, point: Floats, variances: Floats, axes: Floats) -> Updates:
    """After a fix (2,) with independent errors of variances (2,) along axes, the columns of (2, 2)."""
    roots, scores = _roots(covs), np.zeros(len(means))
    for variance, axis in zip(variances.tolist(), axes.T, strict=True):
        innovation = (point - means[:, PLACE]) @ axis
        slopes, each = np.broadcast_to(axis, (len(means), 2)), np.full(len(means), variance)
        means, roots, more = _updated_along(means, roots, innovation, slopes, each)
        scores = scores + more
    return means, roots @ roots.transpose(0, 2, 1), scores


def _roots(covs: Floats) -> Floats:
    """(K, 4, 4) R of each covariance R Rᵀ; what rounding has made negative is 0."""
    values, axes = np.linalg.eigh(covs)
    roots: Floats = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return roots


def _updated_along(means: Floats, roots: Floats, innovation: Floats, slopes: Floats, variances: Floats) -> Updates:
    """After one number, its innovations (K,), its slopes (K, 2) by the position, and its variances (K,).

    Takes and returns roots R (K, 4, n) of covariances R Rᵀ, those returned with another column.
    """
    seen = np.einsum("kin,ki->kn", roots[:, PLACE], slopes)
    spread = (seen * seen).sum(axis=1) + variances
    gain = np.einsum("kin,kn->ki", roots, seen) / spread[:, None]
    left = roots - gain[:, :, None] * seen[:, None, :]
    noise = gain * np.sqrt(variances)[:, None]
    later = means + gain * innovation[:, None]
    return later, np.concatenate([left, noise[:, :, None]], axis=2), -0.5 * (innovation**2 / spread + np.log(spread))
