"""One step of the bootstrap particle filter in one kernel call, for the models of `motion` and `sensing`.

    cloud, log_weights, mean, cov, effective = step(cloud, log_weights, key, ...)

It calls the kernels that a tracker calls for other models, one after the other: predict, score, update. The results are
the same.
"""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Floats
from wsnsim.kernels.compilation import kernel
from wsnsim.kernels.motion import Drift, Root, propagate
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.particles import update
from wsnsim.kernels.sensing import Law, joint_log_likelihood


@kernel
def step(
    cloud: Floats,
    log_weights: Floats,
    key: np.uint64,
    predict: int,
    tooth: int,
    steps: int,
    drift: Drift,
    root: Root,
    readings: Floats,
    positions: Floats,
    gains: Floats,
    law: Law,
    least: float,
) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Predict particles (4, N) over model steps, score them by readings (S,), and update: see `particles.update`.

    Args:
        cloud: Particles (4, N), rows px, vx, py, vy.
        log_weights: Their log-weights (N,).
        key: The head's counter key of this step.
        predict: Tag of the particle keys of the first model step; later ones have the next tags.
        tooth: Which of the key's uniforms is the first tooth of the resampling.
        steps: How many model steps have passed.
        drift: The constants of the drift: see `motion`.
        root: The root of the process covariance: see `motion`.
        readings: Readings (S,).
        positions: Positions (S, 2) of the sensors.
        gains: Gains (S,) of the sensors.
        law: The constants of `sensing`.
        least: The least effective number without a resampling.
    """
    keys, offsets = np.array([key]), np.array([0, log_weights.size])
    for passed in range(steps):
        cloud = propagate(cloud, particle_keys(keys, offsets, predict + passed), drift, root)
    scores = joint_log_likelihood(cloud[0], cloud[2], readings, positions, gains, law)
    return update(cloud, log_weights, scores, least, key, tooth)
