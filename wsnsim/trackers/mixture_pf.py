"""Cluster: a Rao-Blackwellised particle filter, particles for whether the target turns, Kalman filters for where it is.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.requests import Compute, Flow, Parcel, Send
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.heads import HeadFilter
from wsnsim.trackers.shared.localising import fix_cycles, fixed, usable
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings

COLUMNS: Final = ("px", "vx", "py", "vy")
PLACE: Final = np.array([0, 2])
MOVING: Final = np.array([1, 3])
ENOUGH_RANGES: Final = 3
"""Ranges that make a fix; of fewer each updates the filters by itself."""
UNKNOWN: Final = 1e6
"""m: the deviation of a fix where its ranges leave it open: it must not tell the filters what they said themselves."""
MOMENTS_BITS: Final = 800
"""100 bytes: a mean and a covariance."""
LEAST_FIXES: Final = 4
"""Fewer give no prediction (Li 2012's page: initial and re-acquisition)."""
TURN, RESAMPLE = 1, 2
"""Purposes of a head's draws at a step."""
PREDICT_CYCLES: Final = 45.0
"""Operations a particle to draw its mode 3, and to keep its course: the mean 4, F P Fᵀ row by row 32, its noise 6.

A turn costs less; what a node computes is counted for every particle, though here equal ones are kept once. Weighted as
in `shared.localising`."""
FIX_CYCLES: Final = 126.0
"""Operations a particle to update it with a fix: innovation and its covariance 5, the inverse 9, gain 24, mean 16,
covariance 40, log-weight 32."""
COVARIANCE_CYCLES: Final = (60.0, 33.0)
"""Operations of a fix's covariance, and a range: direction and variance 18, sums 15."""
RANGE_CYCLES: Final = 92.0
"""Operations a particle and range: innovation and gradient 16, its variance 16, gain 7, mean 8, covariance 20,
log-weight 25."""
MIX_CYCLES: Final = 82.0
"""Operations a particle: weight 25, effective number 2, mean 8, covariance 44, resampling 3."""


@dataclass(frozen=True, slots=True)
class Mixture:
    """Kalman filters by the history of their modes: `counts` (K,) particles share each of `means` (K, 4), `covs`.

    `log_weights` (K,) are of one particle each. `mean` and `cov` are of the whole mixture. `fixes`: how
    often the target was sensed since the track began, its start included.
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
class MixturePf(HeadFilter):
    """Particles draw at each step whether the target has passed a way-point, with probability 1 - exp(-dt/τ).

    If not it goes on with near-constant velocity; if so, its velocity is a new one, N(0, turn_sd²) on each axis. Given
    its modes a particle is a Kalman filter: updated with the least-squares fix of three or more ranges, or with each
    range, linearised, if there are fewer. Particles whose histories are the same have the same filter, which is kept
    once, with their number: it changes nothing but the time that the simulation takes.

    A handover carries mean and covariance, in 100 bytes: the successor's particles all start from them.

    A reconstruction of Yang, Xing, Shi, Pan (2007), known here from one sentence in Li, Jiang, Zhang, Zhang (2012);
    only the 1500 particles are theirs. The filter's motion is its own, whatever the scenario has trackers assume.
    Particles are resampled where their effective number falls below half of them (our choice).
    """

    paper: ClassVar[str] = "Yang, Xing, Shi, Pan (2007), after Li, Jiang, Zhang, Zhang (2012)"
    idea: ClassVar[str] = "Rao-Blackwellised particle filter: particles for the turns, Kalman filters for the state"
    state: ClassVar[str] = "modes, each with a Kalman filter, in the head"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ("ranges",)
    """Methods that its sensor must have in addition to the port's."""

    particles: Annotated[int, Quantity("", ge=1, le=1_000_000), "N_p: particles"] = 1500
    q: Annotated[float, Quantity("m2/s3", ge=0.0, le=1e9), "intensity of the noise in a kept velocity"] = 0.05
    turn_time: Annotated[float, Quantity("s", gt=0.0, le=1e9), "τ: mean time between turns"] = 60.0
    turn_sd: Annotated[float, Quantity("m/s", gt=0.0, le=1e6), "of a new velocity, on each axis"] = 3.0
    start_sd: Annotated[
        tuple[float, float, float, float], Quantity("", gt=0.0, le=1e7), "P0's deviations, in m and m/s"
    ] = (5.0, 3.0, 5.0, 3.0)
    reading_bits: Annotated[int, Quantity("", ge=1, le=100_000), "of a reading on the air"] = 88

    def start(self, prior: Estimate, scene: Scene) -> Flow[Mixture]:
        """The prior's mean with P0, diag(25, 9, 25, 9), or the prior's covariance of the position where that is larger.

        That is our choice: a target may be found by one range, which leaves it anywhere on a circle. Raises RunError
        for another state than its own.
        """
        if scene.motion.columns != COLUMNS:
            raise RunError(_other_state(scene.motion.columns))
        cov, place = np.diag(np.array(self.start_sd) ** 2), np.ix_(PLACE, PLACE)
        if np.trace(prior.cov[place]) > np.trace(cov[place]):
            cov[place] = prior.cov[place]
        return self._collapsed(prior.mean, cov, scene.head, 1)
        yield  # a flow without requests

    def step(self, belief: Mixture, scene: Scene) -> Flow[Mixture]:
        """One step: N_act - 1 readings reach the head, which draws, predicts, updates, weighs and resamples."""
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
        """100 bytes: the mixture's mean and covariance."""
        mask = yield Send(successor, Parcel((belief.mean, belief.cov), 1, MOMENTS_BITS, "handover"))
        return self._collapsed(belief.mean, belief.cov, successor, belief.fixes) if mask.all() else None

    def forecast(self, belief: Mixture, scene: Scene, ahead: int) -> Estimate:
        """The mixture's two moments, so many steps on, turns included."""
        mean, cov = belief.mean, belief.cov
        for _ in range(ahead):
            mean, cov = self._moments_later(mean, cov, scene.dt)
        return Estimate(mean, cov, belief.effective)

    def belief_bits(self, belief: Mixture) -> int:
        """100 bytes."""
        return MOMENTS_BITS

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A state that is not of positions and velocities in the plane."""
        for motion in setup.filter_motions:
            if motion.columns != COLUMNS:
                yield Issue(("tracker", "kind"), _other_state(motion.columns))
                return

    def turn_probability(self, dt: float) -> float:
        """Of a turn within dt s."""
        return -math.expm1(-dt / self.turn_time)

    def foresees(self, belief: Mixture) -> bool:
        """Once the target has been sensed four times, as in every protocol here: before, nobody knows its velocity."""
        return belief.fixes >= LEAST_FIXES

    def _collapsed(self, mean: Floats, cov: Floats, head: int, fixes: int) -> Mixture:
        """All particles alike."""
        return Mixture(mean[None], cov[None], np.array([self.particles]), np.zeros(1), mean, cov, head, fixes)

    def _predicted(self, belief: Mixture, scene: Scene, number: int) -> Mixture:
        """Each particle draws its mode; the filters of both are a step on."""
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
        """Every filter updated, and weighed; and the operations."""
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
        """The mixture with its moments, and the effective number of its particles."""
        each = np.exp(belief.log_weights - belief.log_weights.max())
        weights = belief.counts * each
        effective = float(weights.sum() ** 2 / (weights * each).sum())
        weights = weights / weights.sum()
        mean = weights @ belief.means
        apart = belief.means - mean
        cov = np.einsum("k,kij->ij", weights, belief.covs) + (apart * weights[:, None]).T @ apart
        return replace(belief, mean=mean, cov=symmetric(cov), head=head, effective=effective)

    def _resampled(self, belief: Mixture, scene: Scene) -> Mixture:
        """Systematic resampling where the effective number is below half of the particles."""
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
        """Two moments of the mixture of both modes, a step on."""
        turn = self.turn_probability(dt)
        means, covs = (
            np.concatenate(pair)
            for pair in zip(
                kept_course(mean[None], cov[None], dt, self.q),
                new_course(mean[None], cov[None], dt, self.turn_sd),
                strict=True,
            )
        )
        weights = np.array([1.0 - turn, turn])
        middle = weights @ means
        apart = means - middle
        return middle, symmetric(np.einsum("k,kij->ij", weights, covs) + (apart * weights[:, None]).T @ apart)


def _other_state(columns: tuple[str, ...]) -> str:
    return f"the tracker 'cluster' has the state {' '.join(COLUMNS)}; this motion's is {' '.join(columns)}"


def kept_course(means: Floats, covs: Floats, dt: float, q: float) -> tuple[Floats, Floats]:
    """(K, 4), (K, 4, 4) a step on with near-constant velocity of noise intensity q."""
    axis = np.array([[1.0, dt], [0.0, 1.0]])
    noise = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    transition = np.kron(np.eye(2), axis)
    return means @ transition.T, transition @ covs @ transition.T + np.kron(np.eye(2), noise)


def new_course(means: Floats, covs: Floats, dt: float, sd: float) -> tuple[Floats, Floats]:
    """(K, 4), (K, 4, 4) a step on with a new velocity, N(0, sd²) on each axis, from its beginning on."""
    later, spread, each, place = means.copy(), np.zeros_like(covs), np.arange(len(covs)), np.array(PLACE)
    later[:, MOVING] = 0.0
    for p, v in zip(PLACE, MOVING, strict=True):
        spread[:, p, v] = spread[:, v, p] = sd * sd * dt
        spread[:, v, v] = sd * sd
    spread[np.ix_(each, place, place)] = _of_place(covs) + sd * sd * dt * dt * np.eye(2)
    return later, spread


def updated_by_fix(means: Floats, covs: Floats, point: Floats, noise: Floats) -> tuple[Floats, Floats, Floats]:
    """Filters (K, ...) updated with a position (2,) of covariance (2, 2); the log-likelihoods (K,)."""
    innovation = point - means[:, PLACE]
    spread = _of_place(covs) + noise
    inverse = np.linalg.inv(spread)
    gain = covs[:, :, PLACE] @ inverse
    later = means + np.einsum("kij,kj->ki", gain, innovation)
    cov = covs - gain @ covs[:, PLACE, :]
    square = np.einsum("ki,kij,kj->k", innovation, inverse, innovation)
    return later, 0.5 * (cov + cov.transpose(0, 2, 1)), -0.5 * (square + np.log(np.linalg.det(spread)))


def updated_by_readings(means: Floats, covs: Floats, seen: Evidence, scene: Scene) -> tuple[Floats, Floats, Floats]:
    """Filters (K, ...) updated with one reading after the other, linearised at their means; log-likelihoods (K,)."""
    scores = np.zeros(len(means))
    for i, reading in enumerate(seen.readings.tolist()):
        points = np.ascontiguousarray(means[:, PLACE].T)
        expected, gradients, variances = scene.sensor.linearise(
            points, seen.positions[i : i + 1], seen.traits[i : i + 1]
        )
        g = gradients[0].T
        cross = np.einsum("kij,kj->ki", covs[:, :, PLACE], g)
        spread = np.einsum("ki,ki->k", g, cross[:, PLACE]) + variances[0]
        innovation = reading - expected[0]
        means = means + cross * (innovation / spread)[:, None]
        covs = covs - cross[:, :, None] * cross[:, None, :] / spread[:, None, None]
        scores = scores - 0.5 * (innovation**2 / spread + np.log(spread))
    return means, 0.5 * (covs + covs.transpose(0, 2, 1)), scores


def _of_place(covs: Floats) -> Floats:
    """(K, 2, 2) the position's blocks of covariances (K, 4, 4)."""
    return covs[:, PLACE][:, :, PLACE]
