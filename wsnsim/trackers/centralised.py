"""The reference: a bootstrap particle filter in one head that has every reading.

After Gordon, Salmond, Smith (1993); it stands beside the filters of Jiang, Song, Lin (2013). What a step asks:

    Gather: readings  Compute
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.asks import Compute, Flow, Member
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Estimate, Scene
from wsnsim.kernels.particles import moments, weigh
from wsnsim.trackers.shared.dealing import (
    PREDICT_CYCLES,
    Pool,
    no_particles,
    resampled,
    restored,
    send_all,
    send_moments,
)
from wsnsim.trackers.shared.moments import forecast, predicted, symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings
from wsnsim.trackers.shared.stacks import propagated_by, snapshot


@dataclass(frozen=True, slots=True)
class CentralBelief:
    """Everything is in the head: particles with weights, and their mean and covariance."""

    mean: Floats
    cov: Floats
    pool: Pool
    head: int
    effective: float = float("nan")


@part
class CentralPf:
    """Bootstrap particle filter in the head, on all readings that reach it; systematic resampling below a threshold."""

    paper: ClassVar[str] = "Jiang, Song, Lin (2013)"
    idea: ClassVar[str] = "bootstrap particle filter in one head on all readings: the reference"
    state: ClassVar[str] = "particles in the head"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = "handover particles|gaussian"

    particles: Annotated[int, Quantity("", ge=1), "N_p: particles"] = 400
    threshold: Annotated[float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles"] = 0.5
    handover: Annotated[Literal["particles", "gaussian"], "what a handover carries"] = "particles"

    @property
    def member_cycles(self) -> float:
        """None: members only send their readings, the head does the rest."""
        return 0.0

    def start(self, prior: Estimate, scene: Scene) -> Flow[CentralBelief]:
        """Draw the particles from the prior."""
        pool = yield from self._full(no_particles(prior.mean.size), prior.mean, prior.cov, scene)
        return CentralBelief(prior.mean, prior.cov, pool, scene.head)

    def step(self, belief: CentralBelief, scene: Scene) -> Flow[CentralBelief]:
        """One step: N_act - 1 readings reach the head, 40 + 30 S operations a particle there."""
        pool = yield from self._full(belief.pool, belief.mean, belief.cov, scene)
        seen = yield from gather_readings(scene)
        yield Compute((PREDICT_CYCLES * scene.steps + 30.0 * len(seen.ids)) * self.particles)
        cloud = propagated_by(scene.key, pool.cloud, scene)[1]
        if not seen.ids:
            mean, cov = predicted(belief.mean, belief.cov, scene.motion, scene.dt, scene.steps)
            return replace(belief, mean=mean, cov=cov, pool=replace(pool, cloud=cloud), head=scene.head)
        return self._weighed(Pool(cloud, pool.log_weights), seen, scene)

    def hand_over(self, belief: CentralBelief, scene: Scene, successor: int) -> Flow[CentralBelief | None]:
        """N_p + ceil(N_p / 4) + 4 packets to the successor, or the 4 of the moments alone."""
        if self.handover == "gaussian":
            arrival = yield from send_moments(belief.mean, belief.cov, successor)
        else:
            arrival = yield from send_all(belief.pool, belief.mean, belief.cov, successor)
        if arrival is None:
            return None
        return CentralBelief(arrival.mean, arrival.cov, arrival.pool, successor)

    def estimate(self, belief: CentralBelief) -> Estimate:
        """The weighted particles' moments; the effective number is that before resampling."""
        return Estimate(belief.mean, belief.cov, belief.effective)

    def forecast(self, belief: CentralBelief, scene: Scene, ahead: int) -> Estimate:
        """The estimate `ahead` steps on."""
        return forecast(self.estimate(belief), scene.motion, scene.dt, ahead)

    def snapshot(self, belief: CentralBelief, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(head, particles (D, n), weights (n,)): all of them."""
        return snapshot([(belief.head, belief.pool.cloud, belief.pool.log_weights)])

    def _full(self, pool: Pool, mean: Floats, cov: Floats, scene: Scene) -> Flow[Pool]:
        """The pool with its full number of particles, which losses on a handover may have reduced."""
        if pool.log_weights.size == self.particles:
            return pool
        cloud = yield from restored(pool, mean, cov, self.particles, scene.key)
        return Pool(cloud, np.zeros(self.particles))

    def _weighed(self, pool: Pool, seen: Evidence, scene: Scene) -> CentralBelief:
        """Weigh with all readings; resample if too few particles are effective."""
        points = pool.cloud[list(scene.motion.position)]
        fitness = scene.sensor.log_likelihood(points, seen.readings, seen.positions, seen.traits)
        log_weights = pool.log_weights + fitness
        everyone = np.array([0, log_weights.size])
        effective = float(weigh(log_weights, everyone)[0])
        means, covs = moments(pool.cloud, log_weights, everyone)
        cloud = pool.cloud
        if effective < self.threshold * self.particles:
            cloud = np.take(cloud, resampled(log_weights, self.particles, scene.key), axis=1)
            log_weights = np.zeros(self.particles)
        return CentralBelief(means[0], symmetric(covs[0]), Pool(cloud, log_weights), scene.head, effective)
