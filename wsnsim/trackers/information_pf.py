"""A particle filter in the head, whose particles are drawn where an extended Kalman filter expects the target.

The baseline IPF of Jiang, Song, Lin (2013), after van der Merwe, Doucet, de Freitas, Wan (2000). Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Member, Send
from wsnsim.base.setups import NetworkSetup
from wsnsim.kernels import gaussian
from wsnsim.kernels.particles import moments
from wsnsim.trackers.shared.dealing import (
    PREDICT_CYCLES,
    Pool,
    arrival_of,
    handover_parcel,
    no_particles,
    resampled,
    restored,
    send_moments,
)
from wsnsim.trackers.shared.heads import CloudBelief, HeadFilter, keys_of, score_of, summary
from wsnsim.trackers.shared.moments import noise_issues, predicted, symmetric
from wsnsim.trackers.shared.readings import Evidence, arrived_groups, covariance_packets, gather_readings, state_packets
from wsnsim.trackers.shared.stacks import MOVE, Score, propagated_by, snapshot


@dataclass(frozen=True, slots=True)
class InformationBelief(CloudBelief):
    """The belief, held by the head: weighted particles, their moments, and each particle's covariance (N, D, D).

    Only with `proposal: per_particle` do particles have covariances; otherwise the array is (0, D, D).
    """

    covariances: Floats = field(default_factory=lambda: np.empty((0, 0, 0)))


@part
class InformationPf(HeadFilter):
    """IPF: particles are drawn from a Gaussian updated with all readings, and weighed by prediction over proposal.

    `proposal`: `per_particle` carries a covariance with each particle, `local` starts each update from the process
    noise. A particle then has an ancestor, and its weight is multiplied by p(z|x) p(x|x_prev) / q(x). With `cloud` all
    particles are drawn from one update of the whole cloud. They have no ancestors: a weight is p(z|x) N(x; m, P) / q(x)
    with the predicted mean m and covariance P of the whole cloud, and earlier weights enter through these moments alone
    (our choice; the paper gives no formula). The state-dependent variance of a reading is taken where the update is
    linearised.
    """

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles"] = 400
    proposal: Annotated[
        Literal["per_particle", "local", "cloud"], "whose covariance a particle's proposal starts from"
    ] = "per_particle"
    threshold: Annotated[float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles"] = 0.5
    handover: Annotated[Literal["particles", "gaussian"], "what a handover carries"] = "particles"

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if the process noise is singular: the weights need a transition density."""
        yield from noise_issues(setup, "the weight of ipf")

    def start(self, prior: Estimate, scene: Scene) -> Flow[InformationBelief]:
        """Draw the particles from the prior, each with the prior's covariance."""
        size = prior.mean.size
        nothing, pool = np.empty((0, size, size)), no_particles(size)
        empty = InformationBelief(prior.mean, prior.cov, scene.head, pool=pool, covariances=nothing)
        return (yield from self._complete(empty, scene))

    def step(self, belief: InformationBelief, scene: Scene) -> Flow[InformationBelief]:
        """One step: N_act - 1 readings reach the head, which does the rest."""
        belief = yield from self._complete(belief, scene)
        seen = yield from gather_readings(scene)
        yield Compute(self._cycles(len(seen.ids)) + PREDICT_CYCLES * (scene.steps - 1) * self.particles)
        if not seen.ids:
            return self._predict(belief, scene)
        if scene.steps > 1:
            belief = self._predict(belief, replace(scene, step=scene.step - 1, steps=scene.steps - 1))
        return self._update(belief, seen, scene)

    def hand_over(self, belief: InformationBelief, scene: Scene, successor: int) -> Flow[InformationBelief | None]:
        """Send N_p + ceil(N_p / 4) + 4 packets, 3 N_p more with covariances; for `gaussian` only the moments' 4."""
        size = belief.mean.size
        if self.handover == "gaussian":
            arrival = yield from send_moments(belief.mean, belief.cov, successor)
            covariances = np.empty((0, size, size))
        else:
            parcel = handover_parcel(belief.pool, belief.mean, belief.cov)
            first = parcel.packets
            parcel.packets += len(belief.covariances) * covariance_packets(size)
            parcel.payload = (*parcel.payload, belief.covariances)
            mask = yield Send(successor, parcel)
            arrival = arrival_of(belief.pool, belief.mean, belief.cov, mask[:first])
            covariances = _arrived_covariances(belief, mask, first)
        if arrival is None:
            return None
        return InformationBelief(arrival.mean, arrival.cov, successor, pool=arrival.pool, covariances=covariances)

    def snapshot(self, belief: InformationBelief, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """All particles, as (head, particles (D, n), weights (n,))."""
        return snapshot([(belief.head, belief.pool.cloud, belief.pool.log_weights)])

    def _cycles(self, sensors: int) -> float:
        """Section 5: 300 + 110 S per particle; for `cloud` 400 + 70 S once and 100 + 40 S each; prediction 40."""
        if not sensors:
            return PREDICT_CYCLES * self.particles
        if self.proposal == "cloud":
            return 400.0 + 70.0 * sensors + self.particles * (100.0 + 40.0 * sensors)
        return self.particles * (300.0 + 110.0 * sensors)

    def _complete(self, belief: InformationBelief, scene: Scene) -> Flow[InformationBelief]:
        """The belief with its full number of particles, each with a covariance if it carries one."""
        pool, covariances = belief.pool, belief.covariances
        count, size = pool.log_weights.size, belief.mean.size
        if count != self.particles and count:
            chosen = resampled(pool.log_weights, self.particles, scene.key)
            pool = Pool(np.take(pool.cloud, chosen, axis=1), np.zeros(self.particles))
            covariances = covariances[chosen] if len(covariances) else covariances
        elif not count:
            cloud = yield from restored(pool, belief.mean, belief.cov, self.particles, scene.key)
            pool = Pool(cloud, np.zeros(self.particles))
        if self.proposal == "per_particle" and len(covariances) != self.particles:
            covariances = np.broadcast_to(belief.cov, (self.particles, size, size)).copy()
        return replace(belief, pool=pool, covariances=covariances)

    def _predict(self, belief: InformationBelief, scene: Scene) -> InformationBelief:
        """The predicted belief: particles moved with noise, covariances F P Fᵀ + Q."""
        covariances = belief.covariances
        before = belief.pool.cloud
        for step in range(scene.steps if len(covariances) else 0):
            now = scene.since + step * scene.dt
            transitions, noise = scene.motion.matrices(before, scene.dt, now)
            covariances = gaussian.predict(covariances, np.ascontiguousarray(transitions), noise)
            before = scene.motion.advance(before, scene.dt, now)
        cloud = propagated_by(scene.key, belief.pool.cloud, scene)[1]
        mean, cov = predicted(belief.mean, belief.cov, scene)
        pool = replace(belief.pool, cloud=cloud)
        return InformationBelief(mean, cov, scene.head, pool=pool, covariances=covariances)

    def _update(self, belief: InformationBelief, seen: Evidence, scene: Scene) -> InformationBelief:
        """Propose, weigh, and resample if too few particles are effective."""
        means, covs, log_prior, log_before = self._propose(belief, seen, scene)
        cloud, log_proposal = gaussian.sample(means, covs, keys_of(scene, self.particles, MOVE))
        log_weights = log_before + score_of(seen, scene)(cloud) + log_prior(cloud) - log_proposal
        mean, cov, effective = summary(cloud, log_weights)
        covariances = covs if self.proposal == "per_particle" else belief.covariances
        pool = Pool(cloud, log_weights)
        if effective < self.threshold * self.particles:
            chosen = resampled(log_weights, self.particles, scene.key)
            pool = Pool(np.take(cloud, chosen, axis=1), np.zeros(self.particles))
            covariances = covariances[chosen] if len(covariances) else covariances
        return InformationBelief(mean, symmetric(cov), scene.head, effective, pool, covariances)

    def _propose(self, belief: InformationBelief, seen: Evidence, scene: Scene) -> tuple[Floats, Floats, Score, Floats]:
        """The proposal of a step: predicted Gaussians, updated with the readings; and how the prediction is weighed.

        Means (D, N) and covariances (N, D, D), or (D, 1), (1, D, D) if it is one Gaussian; the log density of the
        prediction at points (D, N), up to a constant; the log-weights (N,) with which the particles start.
        """
        motion, pool = scene.motion, belief.pool
        before, covs, log_weights = pool.cloud, belief.covariances, pool.log_weights
        if self.proposal == "cloud":
            centre, covs = moments(pool.cloud, pool.log_weights, np.array([0, self.particles]))
            before, log_weights = np.ascontiguousarray(centre.T), np.zeros(self.particles)
        transitions, noise = motion.matrices(before, scene.dt, scene.previous)
        transitions = np.ascontiguousarray(transitions)  # a linear motion's is one matrix broadcast N times
        if self.proposal == "local":
            covs = np.broadcast_to(noise, transitions.shape).copy()
        else:
            covs = gaussian.predict(covs, transitions, noise)
        means = motion.advance(before, scene.dt, scene.previous)
        log_prior = _log_predictive(means, covs) if self.proposal == "cloud" else _log_transition(before, scene)
        columns = np.array(motion.position)
        expected, gradients, variances = scene.sensor.linearise(means[columns], seen.positions, seen.traits)
        measured = rows(scene.sensor, seen.readings)
        expected = near(scene.sensor, expected, measured[:, None])
        gaussian.update(means, covs, expected, gradients, variances, measured, columns)
        return means, covs, log_prior, log_weights


def _log_transition(before: Floats, scene: Scene) -> Score:
    """The log transition density from each particle's ancestor."""
    return lambda cloud: scene.motion.log_transition(cloud, before, scene.dt, scene.previous)


def _log_predictive(means: Floats, covs: Floats) -> Score:
    """The log density, up to its constant, of one Gaussian (D, 1), (1, D, D), as it is now."""
    centre, factors = means.T.copy(), np.zeros(covs.shape)
    gaussian.cholesky(covs[0], factors[0])
    return lambda cloud: gaussian.log_density(cloud, centre, factors, np.array([0, cloud.shape[1]]))


def _arrived_covariances(belief: InformationBelief, mask: Bools, first: int) -> Floats:
    """The covariances (m, D, D) of the arrived particles; a lost one becomes the mean of the others, or the cloud's."""
    count, size = len(belief.covariances), belief.mean.size
    if not count:
        return belief.covariances
    arrived = arrived_groups(mask[first:], count, covariance_packets(size))
    substitute = belief.covariances[arrived].mean(axis=0) if arrived.any() else belief.cov
    covariances = np.where(arrived[:, None, None], belief.covariances, substitute)
    return covariances[arrived_groups(mask, count, state_packets(size))]
