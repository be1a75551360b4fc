"""Silence of members that share an estimate with their head: what they expect, and what it says that they sent nothing.

    mean, cov = heard.with_silence(mean, cov, scene)            after the update with `heard.seen`

A member compares its reading z with what the shared estimate expects, and is silent if they are close. A head takes
its silence as

    p + (1 - p) r P(silent | z)        p: probability that a packet does not arrive, r: that the broadcast did

and replaces the posterior, which is a mixture, by the Gaussian with its mean and covariance, one silent member after
the other, with the readings linearised. So without loss and with a linear sensor one silent member is treated exactly
up to second moments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np

from wsnsim.base.arrays import Floats, near
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.trackers.shared.moments import stepped, symmetric
from wsnsim.trackers.shared.readings import Evidence, moment_packets

LEAST_CHANCE: Final = 1e-12
"""A silence less probable than this is left out: its moments would be rounding errors."""


@dataclass(frozen=True, slots=True)
class SharedEstimate:
    """What a head has broadcast last: the predicted state, or its position alone if it is for one step.

    Attributes:
        mean: (D,) or (P,).
        cov: (D, D) or (P, P) its covariance.
        step: The step to which it was predicted.
    """

    mean: Floats
    cov: Floats
    step: int

    def expects(self, scene: Scene, positions: Floats, traits: Floats) -> ExpectedReadings:
        """What it expects the sensors of S nodes at (S, 2), with traits (S, T), to measure at the step of a scene."""
        mean, cov, place = self.mean, self.cov, list(scene.motion.position)
        if mean.size > len(place):
            mean, cov = stepped(mean, cov, scene.motion, scene.dt, self.step * scene.dt, scene.step - self.step)
            mean, cov = mean[place], cov[np.ix_(place, place)]
        return expected_of(mean, cov, scene.sensor, positions, traits)


class ExpectedReadings(NamedTuple):
    """What the sensors of S nodes are expected to measure of a Gaussian position.

    Attributes:
        values: (S,) ẑ.
        slopes: (S, P) H, by the position.
        noise: (S,) variances R of the readings alone.
        cross: (S, P) covariances of readings and position, H P.
        variances: (S,) H P Hᵀ + R.
    """

    values: Floats
    slopes: Floats
    noise: Floats
    cross: Floats
    variances: Floats


class SilenceMoments(NamedTuple):
    """Silence of one member, in standard deviations of its reading: its probability, and moments if nothing is lost."""

    chance: float
    mean: float
    variance: float


class Silence(Protocol):
    """By what members decide that share an estimate."""

    @property
    def loss(self) -> float:
        """p: probability with which a packet that is sent does not arrive."""

    def widths(self, expected: ExpectedReadings) -> Floats:
        """(S,) how far readings may be from what is expected, in their unit."""

    def silence_of(self, centre: float, width: float) -> SilenceMoments:
        """The silence of a member whose reading is standard normal, if it is silent `width` about `centre`."""


@dataclass(frozen=True, slots=True)
class HeardReadings:
    """What a head has after asking for readings.

    Attributes:
        seen: The readings that arrived.
        shared: What it has broadcast last, None if nothing.
        silent: Rows of `scene.ids` whose silence it uses.
        trigger: By what they decided.
    """

    seen: Evidence
    shared: SharedEstimate | None = None
    silent: tuple[int, ...] = ()
    trigger: Silence | None = None

    def with_silence(self, mean: Floats, cov: Floats, scene: Scene) -> tuple[Floats, Floats]:
        """Mean (D,) and covariance (D, D) after the silence of members, which comes after all readings.

        Args:
            mean: After the update with the readings that arrived.
            cov: Its covariance.
            scene: What the head knows.
        """
        if not self.silent or self.trigger is None or self.shared is None:
            return mean, cov
        rows, place, start = list(self.silent), list(scene.motion.position), mean
        nodes = scene.positions[rows], scene.traits[rows]
        expected = self.shared.expects(scene, *nodes)
        now = expected_of(mean[place], cov[np.ix_(place, place)], scene.sensor, *nodes)
        centres, widths = near(scene.sensor, expected.values, now.values), self.trigger.widths(expected)
        loss = self.trigger.loss
        for row, slope in enumerate(now.slopes):
            cross = cov[:, place] @ slope
            sd = math.sqrt(float(slope @ cross[place] + now.noise[row]))
            centre = now.values[row] + slope @ (mean - start)[place]
            moments = self.trigger.silence_of(float(centres[row] - centre) / sd, float(widths[row]) / sd)
            if moments.chance < LEAST_CHANCE:
                continue
            shift, left = _with_loss(moments, loss, (1.0 - loss) ** moment_packets(self.shared.mean.size))
            mean = mean + cross * (shift / sd)
            cov = symmetric(cov - np.outer(cross, cross) * ((1.0 - left) / sd**2))
        return mean, cov


def expected_of(point: Floats, cov: Floats, sensor: SensorModel, positions: Floats, traits: Floats) -> ExpectedReadings:
    """What the sensors of S nodes are expected to measure of a Gaussian position, linearised at its mean.

    Args:
        point: (P,) its mean.
        cov: (P, P) its covariance.
        sensor: Their sensor model.
        positions: (S, 2) of the nodes in m.
        traits: (S, T) of their sensors.
    """
    values, gradients, noise = sensor.linearise(point[:, None], positions, traits)
    slopes = gradients[:, :, 0]
    cross = slopes @ cov
    return ExpectedReadings(values[:, 0], slopes, noise[:, 0], cross, (slopes * cross).sum(axis=1) + noise[:, 0])


def _with_loss(moments: SilenceMoments, loss: float, informed: float) -> tuple[float, float]:
    """Mean and variance of a standard normal reading that did not arrive.

    It was lost, or its member has the shared estimate, with the probability `informed`, and was silent.
    """
    chance, mean, variance = moments
    silent = (1.0 - loss) * informed * chance
    total = loss + silent
    first = silent * mean / total
    return first, (loss + silent * (variance + mean**2)) / total - first**2
