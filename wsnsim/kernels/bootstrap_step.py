"""Prediction and scores of a step of the bootstrap particle filter in one kernel call, for `motion` and `sensing`.

It calls the kernels that a tracker calls for other models, one after the other. What is summed over particles (weights,
moments) stays in kernels of its own: compiled into a caller, sums are added in another order, with other rounding.
"""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Floats
from wsnsim.kernels.compilation import kernel
from wsnsim.kernels.motion import Drift, Root, propagate
from wsnsim.kernels.noise import particle_keys
from wsnsim.kernels.sensing import Law, joint_log_likelihood


@kernel
def predict_and_score(
    cloud: Floats,
    key: np.uint64,
    tag: int,
    steps: int,
    drift: Drift,
    root: Root,
    readings: Floats,
    positions: Floats,
    gains: Floats,
    law: Law,
) -> tuple[Floats, Floats]:
    """Particles (4, N) after several model steps, and the log-likelihoods (N,) of all readings (S,) there.

    Args:
        cloud: Particles (4, N), rows px, vx, py, vy.
        key: The head's counter key of this step.
        tag: Tag of the particle keys of the first model step; later ones have the next tags.
        steps: How many model steps have passed.
        drift: The constants of the drift: see `motion`.
        root: The root of the process covariance: see `motion`.
        readings: Readings (S,).
        positions: Positions (S, 2) of the sensors.
        gains: Gains (S,) of the sensors.
        law: The constants of `sensing`.
    """
    keys, offsets = np.array([key]), np.array([0, cloud.shape[1]])
    for passed in range(steps):
        cloud = propagate(cloud, particle_keys(keys, offsets, tag + passed), drift, root)
    return cloud, joint_log_likelihood(cloud[0], cloud[2], readings, positions, gains, law)
