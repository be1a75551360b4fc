"""Bootstrap particle filters in one head that has every reading: the reference, and the textbook filter.

Gordon, Salmond, Smith (1993). `central_pf` stands beside the filters of Jiang, Song, Lin (2013); with `pf`, Wei, Guo
(2022) and Ruan et al. (2020) compare. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow
from wsnsim.trackers.shared.dealing import Pool
from wsnsim.trackers.shared.gains import gain_prior
from wsnsim.trackers.shared.heads import CloudBelief, HeadCloud, bootstrap, bootstrap_with_gains
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.whole_runs import cloud_runs


class Bootstrap(HeadCloud):
    """The base of filters that predict, weigh with all readings, and resample below a fraction: a field `threshold`."""

    estimates_gains: ClassVar[bool] = True
    threshold: float

    def filtered(self, pool: Pool, seen: Evidence, scene: Scene) -> CloudBelief:
        """Predict, weight and perhaps resample: mean, covariance and effective number are those before resampling."""
        return bootstrap(pool, seen, scene, self.threshold)

    def filtered_with_gains(self, belief: CloudBelief, seen: Evidence, scene: Scene) -> Flow[CloudBelief]:
        """As `filtered`, with the gains of sensors marginalised: see `shared.heads`."""
        return bootstrap_with_gains(belief, seen, scene, self.threshold)

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
class Sir(Bootstrap):
    """Sampling importance resampling (SIR) in the head, on all readings that reach it."""

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles"] = 100
    threshold: Annotated[
        float, Quantity("", ge=0, le=1), "resample below this fraction of effective particles; 1: at every step"
    ] = 1.0
