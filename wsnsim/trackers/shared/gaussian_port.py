"""The port of single-target filters whose belief is Gaussian to trackers of several targets.

    tracker.gaussian(motion) -> GaussianPort        of `ekf`, `ukf`, `ckf` and `imm`

A tracker of several targets gates, weighs and updates by the joint moments of a state and of the readings expected of
some sensors, whatever filter they come from: see `kernels.detections`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.trackers.shared.whole_runs import predicted


class GaussianBank(NamedTuple):
    """The states of N targets, each a mixture of one Gaussian per mode.

    Attributes:
        means: (N, K, D); K is 1 for filters of one motion model.
        covs: (N, K, D, D).
        chances: (N, K) the probabilities of the modes.
    """

    means: Floats
    covs: Floats
    chances: Floats


class GaussianPort(Protocol):
    """A Gaussian filter of a single target, for many targets at once. Its state may have further columns."""

    def begun(self, mean: Floats, cov: Floats) -> GaussianBank:
        """The bank (N = 1) of a prior in the columns of the scenario's motion."""

    def predicted(self, bank: GaussianBank, dt: float, time: float) -> GaussianBank:
        """The bank one step of `dt` after `time`."""

    def joint(
        self, bank: GaussianBank, sensor: SensorModel, positions: Floats, traits: Floats
    ) -> tuple[Floats, Floats]:
        """Joint means (N K, D + S d) and covariances of each state and of the d components read by each of S sensors.

        Those of the readings include their noise.
        """

    @property
    def own(self) -> list[int]:
        """The columns of the scenario's motion."""


class LinearisedPort:
    """The extended Kalman filter: readings are linearised at the predicted mean."""

    def __init__(self, motion: MotionModel) -> None:
        self._motion, self.own = motion, list(range(len(motion.columns)))

    def begun(self, mean: Floats, cov: Floats) -> GaussianBank:
        """One mode, the prior."""
        return GaussianBank(mean[None, None], cov[None, None], np.ones((1, 1)))

    def predicted(self, bank: GaussianBank, dt: float, time: float) -> GaussianBank:
        """The bank one step later."""
        means, covs = predicted(bank.means[:, 0], bank.covs[:, 0], self._motion, dt, time)
        return GaussianBank(means[:, None], covs[:, None], bank.chances)

    def joint(
        self, bank: GaussianBank, sensor: SensorModel, positions: Floats, traits: Floats
    ) -> tuple[Floats, Floats]:
        """Joint moments of states and readings."""
        return linearised_joint(bank, list(self._motion.position), sensor, positions, traits)


def linearised_joint(
    bank: GaussianBank, place: list[int], sensor: SensorModel, positions: Floats, traits: Floats
) -> tuple[Floats, Floats]:
    """Joint means (N K, A) and covariances (N K, A, A) of states and readings, linearised at the means."""
    size = bank.means.shape[-1]
    means, covs = bank.means.reshape(-1, size), bank.covs.reshape(-1, size, size)
    linear = sensor.linearise(np.ascontiguousarray(means[:, place].T), positions, traits)
    expected, slopes, variances = linear[0].T, linear[1].transpose(2, 0, 1), linear[2].T
    cross = slopes @ covs[:, place]
    widths = cross[:, :, place] @ slopes.transpose(0, 2, 1)
    rows = np.arange(expected.shape[1])
    widths[:, rows, rows] += variances
    return np.concatenate([means, expected], axis=1), joined(covs, cross, widths)


def joined(covs: Floats, cross: Floats, widths: Floats) -> Floats:
    """The covariances (N, D + R, D + R) of states (N, D, D) and readings (N, R, R), with those between (N, R, D)."""
    above = np.concatenate([covs, cross.transpose(0, 2, 1)], axis=2)
    return np.concatenate([above, np.concatenate([cross, widths], axis=2)], axis=1)
