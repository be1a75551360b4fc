"""Bootstrap particle filters in one head that has every reading: the reference, and the textbook filter.

Gordon, Salmond, Smith (1993). `central_pf` stands beside the filters of Jiang, Song, Lin (2013); with `pf`, Wei, Guo
(2022) and Ruan et al. (2020) compare. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow
from wsnsim.trackers.shared.dealing import Pool, resampled
from wsnsim.trackers.shared.gains import gain_prior
from wsnsim.trackers.shared.heads import CloudBelief, HeadCloud, score_of, summary, weighed_with_gains
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.stacks import propagated_by
from wsnsim.trackers.shared.whole_runs import cloud_runs


class Bootstrap(HeadCloud):
    """The base of filters that predict, weigh with all readings, and resample below a fraction: a field `threshold`."""

    estimates_gains: ClassVar[bool] = True
    threshold: float

    def filtered(self, pool: Pool, seen: Evidence, scene: Scene) -> CloudBelief:
        """Predict, weight and perhaps resample: mean, covariance and effective number are those before resampling."""
        _, cloud = propagated_by(scene.key, pool.cloud, scene)
        log_weights = pool.log_weights + score_of(seen, scene)(cloud)
        mean, cov, effective = summary(cloud, log_weights)
        return self._resampled(CloudBelief(mean, cov, scene.head, effective, Pool(cloud, log_weights)), scene.key)

    def filtered_with_gains(self, belief: CloudBelief, seen: Evidence, scene: Scene) -> Flow[CloudBelief]:
        """As `filtered`, with the gains of sensors marginalised: see `weighed_with_gains`."""
        before, log_weights = belief.pool.cloud, belief.pool.log_weights
        _, cloud = propagated_by(scene.key, before, scene)
        after = yield from weighed_with_gains(belief, before, cloud, seen, scene, log_weights)
        return self._resampled(after, scene.key)

    def _resampled(self, after: CloudBelief, key: int) -> CloudBelief:
        """A belief with equal weights, if its effective number is below the threshold; with 1: always."""
        cloud, log_weights = after.pool.cloud, after.pool.log_weights
        if self.threshold < 1.0 and not after.effective < self.threshold * log_weights.size:
            return after
        cloud = np.take(cloud, resampled(log_weights, log_weights.size, key), axis=1)
        return replace(after, pool=Pool(cloud, np.zeros(log_weights.size)))

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """All steps of many standalone runs: `WholeRuns`; not with gains that are estimated."""
        if gain_prior(block.sensor):
            return None
        outcome = cloud_runs(block, self.particles, self.threshold)
        return outcome.closed(self.block_cycles(outcome.counts))


@part
class CentralPf(Bootstrap):
    """Bootstrap particle filter in the head, on all readings that reach it; systematic resampling below a threshold."""

    threshold: Annotated[float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles"] = 0.5


@part
class Pf(Bootstrap):
    """Sampling importance resampling (SIR) in the head, on all readings that reach it."""

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles"] = 100
    threshold: Annotated[
        float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles; 1: at every step"
    ] = 1.0
