"""Particles weighed by readings whose sensors have unknown gains, which are estimated beside the state.

    bootstrap_with_gains(belief, seen, scene, threshold)              of the bootstrap filter: `heads.bootstrap`
    weighed_with_gains(belief, before, cloud, seen, scene)            of the Gaussian particle filter

Noise counts as normal, whatever the sensor model says: only then are gains Gaussian given a particle (our choice).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow
from wsnsim.trackers.shared.dealing import Pool, resampled
from wsnsim.trackers.shared.gains import GainsOfParticles, gain_prior, no_gains
from wsnsim.trackers.shared.heads import CloudBelief, GaussianBelief, summary
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.stacks import place_of, propagated_by


def bootstrap_with_gains(belief: CloudBelief, seen: Evidence, scene: Scene, threshold: float) -> Flow[CloudBelief]:
    """As `heads.bootstrap`: predict, weigh with all readings, sum up, resample below a fraction; with the gains."""
    before = belief.pool.cloud
    _, cloud = propagated_by(scene.key, before, scene)
    after = yield from weighed_with_gains(belief, before, cloud, seen, scene, belief.pool.log_weights)
    count = before.shape[1]
    if threshold < 1.0 and not after.effective < threshold * count:
        return after
    chosen = resampled(after.pool.log_weights, count, scene.key)
    return replace(after, pool=Pool(np.take(cloud, chosen, axis=1), np.zeros(count)))


def weighed_with_gains(
    belief: GaussianBelief,
    before: Floats,
    cloud: Floats,
    seen: Evidence,
    scene: Scene,
    log_weights: Floats | float = 0.0,
) -> Flow[CloudBelief]:
    """The belief after readings: moments, effective number and weights of the particles, and the gains.

    Args:
        belief: the moments of state and gains before the step.
        before: (D, N) particles at the time of the belief.
        cloud: (D, N) the same particles now.
        seen: at least one reading.
        scene: the scene.
        log_weights: (N,) of the particles before the readings.
    """
    gains = belief.gains or no_gains(belief.mean.size)
    gains = gains.with_nodes(seen.ids, gain_prior(scene.sensor))
    yield Compute(_cycles(cloud, len(gains.nodes), len(seen.ids)))
    given = GainsOfParticles.given(gains, belief.mean, belief.cov, before)
    expected, _, variances = scene.sensor.linearise(cloud[place_of(scene)], seen.positions, seen.traits)
    given, scores = given.weighed(expected, variances, seen)
    scores += log_weights
    mean, cov, effective = summary(cloud, scores)
    gains = given.joint(cloud, mean, scores)
    return CloudBelief(mean, cov, scene.head, effective, Pool(cloud, scores), gains=gains)


def _cycles(cloud: Floats, gains: int, readings: int) -> float:
    """Operations beyond those without gains: a particle's means of gains, its share of the update, and the moments."""
    each: float = 2.0 * gains * (2 * len(cloud) + readings + gains)
    return each * (cloud.size // len(cloud))
