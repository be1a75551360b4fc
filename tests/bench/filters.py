"""The reference problem, and what a tracker makes of it with the building blocks of wsnsim.

A target of bounded velocity for 600 steps of 0.04 s, ten energy sensors that all hear it at every step, equal weights
at first, systematic resampling below half of the particles. All of it after kernels.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Estimate
from wsnsim.base.network_ports import Field
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Member
from wsnsim.base.rng import derive, derive_all
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.offline.loopback import perform
from wsnsim.trackers.bootstrap_pf import CentralPf

STEPS, SENSORS, DT, THRESHOLD, SEED = 600, 10, 0.04, 0.5, 77
SD = np.array([3.0, 1.0, 3.0, 1.0])


class Reference(NamedTuple):
    """The problem: truth (601, 4), and what the program in C is given but for its noise."""

    truth: np.ndarray
    arguments: tuple[Any, ...]
    prior: Estimate

    @property
    def keys(self) -> np.ndarray:
        """(600,) a key a step."""
        return derive_all(SEED, np.arange(STEPS))

    def error(self, means: np.ndarray) -> float:
        """Root mean square error of the position, in m."""
        return float(np.sqrt(((means - self.truth[1:])[:, [0, 2]] ** 2).sum(axis=1).mean()))


def reference(particles: int) -> Reference:
    """The problem for so many particles; truth, sensors and readings are always the same."""
    rng = np.random.default_rng(1)
    motion, sensor = BoundedVelocity(), AcousticEnergy()
    truth = motion.truth(STEPS, DT, rng)
    positions, traits = rng.uniform(-200.0, 200.0, (SENSORS, 2)), sensor.draw_traits(SENSORS, rng)
    points, noise = np.repeat(truth[1:, [0, 2]], SENSORS, axis=0), rng.standard_normal(STEPS * SENSORS)
    readings = sensor.measure(points, np.tile(positions, (STEPS, 1)), np.tile(traits, (STEPS, 1)), noise)
    prior = Estimate(truth[0] + SD * rng.standard_normal(4), np.diag(SD**2))
    start = prior.mean[:, None] + SD[:, None] * rng.standard_normal((4, particles))
    law, drift = sensor.law(), (DT, motion.bound, motion.c1, motion.c2)
    root = np.linalg.cholesky(motion.matrices(truth[:1].T, DT)[1][:2, :2])
    constants = law, drift, (root[0, 0], root[1, 0], root[1, 1]), THRESHOLD
    gains = np.ascontiguousarray(traits[:, 0])
    return Reference(truth, (start, readings.reshape(STEPS, SENSORS), positions, gains, *constants), prior)


def composed(problem: Reference) -> Callable[[], np.ndarray]:
    """The same filter as a tracker asks for it, step by step, over the loopback driver: an act that gives (600, 4)."""
    start, readings, positions, gains = problem.arguments[:4]
    ids, traits = tuple(range(SENSORS)), gains[:, None]
    tracker = CentralPf(particles=start.shape[1], threshold=THRESHOLD)
    motion, sensor, field = BoundedVelocity(), AcousticEnergy(), Field(400.0, 400.0)

    def scene(step: int) -> Scene:
        return Scene(
            time=DT * step, step=step, steps=min(step, 1), dt=DT, target=0, head=0, ids=ids, positions=positions,
            traits=traits, roster=ids, joined=() if step else ids, left=(), field=field, motion=motion, sensor=sensor,
            key=derive(SEED, step),
        )  # fmt: skip

    def act() -> np.ndarray:
        members = {i: Member(i, positions[i], traits[i]) for i in ids}
        belief = perform(tracker.start(problem.prior, scene(0)), members, 0)
        means = np.empty((STEPS, 4))
        for step in range(1, STEPS + 1):
            for i, member in members.items():
                member.reading = float(readings[step - 1, i])
            belief = perform(tracker.step(belief, scene(step)), members, 0)
            means[step - 1] = tracker.estimate(belief).mean
        return means

    return act
