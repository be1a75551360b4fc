"""The error covariances of a bound, from initial conditions and used readings, by the recursion that fits.

covariances(setup, conditions, used_by, kind, gains) -> (R, targets, steps, D, D)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.ports import MotionModel
from wsnsim.base.setups import TrackingSetup
from wsnsim.bounds import unknown_gains
from wsnsim.bounds.information import UsedReadings, information
from wsnsim.bounds.initial_conditions import process_noise
from wsnsim.bounds.recursion import LinearisedMotion, along_trajectories, over_trajectories

UsedBy = Callable[[int, int], UsedReadings]
"""(row of the run among the initial conditions, target) -> the readings that count."""


def covariances(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    used_by: UsedBy,
    kind: str,
    gains: str,
    detected: float = 1.0,
) -> Floats:
    """The least error covariances, (R, targets, steps, D, D): R is the number of runs per trajectory, else 1.

    Args:
        setup: motion models, sensor model and steps.
        conditions: one per run.
        used_by: which readings count.
        kind: `unconditional` or `per_trajectory`.
        gains: `known` or `unknown` to the filters.
        detected: the probability of detection in range; expected information is scaled by it.

    Raises:
        ValueError: there is no bound; the message says why.
    """
    along = kind == "per_trajectory"
    targets = range(len(setup.motions))
    if along and gains == "unknown" and unknown_gains.has_gains(setup.sensor):
        found = [_with_unknown_gains(setup, conditions, used_by, target, detected) for target in targets]
    else:
        found = [_with_known_gains(setup, conditions, used_by, target, along, detected) for target in targets]
    return np.stack(found, axis=1)


def _with_known_gains(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    used_by: UsedBy,
    target: int,
    along: bool,
    detected: float,
) -> Floats:
    """(R, steps, D, D) of one target."""
    motion, truths, priors = _of_target(setup, conditions, target)
    place = list(motion.position)
    told = np.stack([
        information(setup.sensor, truth[:, place], one.positions, one.traits, used_by(row, target))[1:]
        for row, (one, truth) in enumerate(zip(conditions, truths, strict=True))
    ], axis=1)  # fmt: skip
    motions = _linearised(motion, truths, setup.dt)
    if along:
        return along_trajectories(motions, priors, detected * told, place).swapaxes(0, 1)
    return over_trajectories(motions, priors, detected * told, place)[None]


def _with_unknown_gains(
    setup: TrackingSetup, conditions: Sequence[InitialConditions], used_by: UsedBy, target: int, detected: float
) -> Floats:
    """(R, steps, D, D) of one target, for filters that do not know the gains."""
    motion, truths, priors = _of_target(setup, conditions, target)
    place, result = list(motion.position), []
    for row, (one, truth) in enumerate(zip(conditions, truths, strict=True)):
        used = used_by(row, target)
        readings = unknown_gains.linearised_readings(setup.sensor, truth[:, place], one.positions, one.traits, used)
        readings = readings._replace(weights=detected * readings.weights)
        motions = _linearised(motion, truth[None], setup.dt)
        spread = setup.sensor.gain_spread  # type: ignore[attr-defined]
        result.append(unknown_gains.along_trajectory(motions, priors[row], readings, used, place, spread))
    return np.array(result)


def _of_target(
    setup: TrackingSetup, conditions: Sequence[InitialConditions], target: int
) -> tuple[MotionModel, Floats, Floats]:
    """A target's motion model, trajectories (R, steps + 1, D) and prior covariances (R, D, D)."""
    truths = np.array([one.truths[target] for one in conditions])
    return setup.motions[target], truths, np.array([one.priors[target].cov for one in conditions])


def _linearised(motion: MotionModel, truths: Floats, dt: float) -> Iterator[LinearisedMotion]:
    """The motion model linearised at the trajectories, step by step."""
    for step in range(truths.shape[1] - 1):
        jacobian, noise = motion.matrices(np.ascontiguousarray(truths[:, step].T), dt, step * dt)
        yield jacobian, process_noise(motion, noise)
