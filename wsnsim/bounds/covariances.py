"""The error covariances of a bound, from initial conditions and used readings, by the recursion of its kind.

covariances(setup, conditions, readings_of, kind, unknown) -> (R, targets, steps, D, D)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.ports import MotionModel
from wsnsim.base.setups import TrackingSetup
from wsnsim.bounds import unknown_constants
from wsnsim.bounds.information import UsedReadings, information
from wsnsim.bounds.initial_conditions import process_noise
from wsnsim.bounds.recursion import LinearisedMotion, along_trajectories, over_trajectories
from wsnsim.bounds.unknown_constants import UnknownConstants

ReadingsOf = Callable[[int, int], UsedReadings]
"""(index of the run in the initial conditions, target) -> the readings that the bound uses."""


def covariances(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    readings_of: ReadingsOf,
    kind: str,
    unknown: UnknownConstants,
    detected: float = 1.0,
) -> Floats:
    """The least error covariances, (R, targets, steps, D, D). R is the number of runs for `per_trajectory`, else 1.

    Args:
        setup: motion models, sensor model and steps.
        conditions: one per run.
        readings_of: which readings the bound uses.
        kind: `unconditional` or `per_trajectory`.
        unknown: what the filters do not know of nodes; counts `per_trajectory` only.
        detected: the probability of detection in range; expected information is scaled by it.

    Raises:
        ValueError: there is no bound; the message says why.
    """
    along = kind == "per_trajectory"
    targets = range(len(setup.motions))
    if along and unknown.variances.size:
        found = [_with_unknown(setup, conditions, readings_of, target, unknown, detected) for target in targets]
    else:
        found = [_with_known(setup, conditions, readings_of, target, along, detected) for target in targets]
    return np.stack(found, axis=1)


def _with_known(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    readings_of: ReadingsOf,
    target: int,
    along: bool,
    detected: float,
) -> Floats:
    """(R, steps, D, D) of one target."""
    motion, truths, priors = _of_target(setup, conditions, target)
    columns = list(motion.position)
    informations = np.stack([
        information(setup.sensor, truth[:, columns], run.positions, run.traits, readings_of(row, target))[1:]
        for row, (run, truth) in enumerate(zip(conditions, truths, strict=True))
    ], axis=1)  # fmt: skip
    motions = _linearised(motion, truths, setup.dt)
    if along:
        return along_trajectories(motions, priors, detected * informations, columns).swapaxes(0, 1)
    return over_trajectories(motions, priors, detected * informations, columns)[None]


def _with_unknown(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    readings_of: ReadingsOf,
    target: int,
    unknown: UnknownConstants,
    detected: float,
) -> Floats:
    """(R, steps, D, D) of one target, for filters that do not know gains or positions of nodes."""
    motion, truths, priors = _of_target(setup, conditions, target)
    columns, result = list(motion.position), []
    for row, (run, truth) in enumerate(zip(conditions, truths, strict=True)):
        used = readings_of(row, target)
        readings, used = unknown_constants.linearised_readings(
            setup.sensor, truth[:, columns], run.positions, run.traits, used, unknown
        )
        readings = readings._replace(weights=detected * readings.weights)
        motions, variances = _linearised(motion, truth[None], setup.dt), unknown.variances
        result.append(unknown_constants.along_trajectory(motions, priors[row], readings, used, columns, variances))
    return np.array(result)


def _of_target(
    setup: TrackingSetup, conditions: Sequence[InitialConditions], target: int
) -> tuple[MotionModel, Floats, Floats]:
    """A target's motion model, trajectories (R, steps + 1, D) and prior covariances (R, D, D)."""
    truths = np.array([run.truths[target] for run in conditions])
    return setup.motions[target], truths, np.array([run.priors[target].cov for run in conditions])


def _linearised(motion: MotionModel, truths: Floats, dt: float) -> Iterator[LinearisedMotion]:
    """The motion model linearised at the trajectories, step by step."""
    for step in range(truths.shape[1] - 1):
        jacobian, noise = motion.matrices(np.ascontiguousarray(truths[:, step].T), dt, step * dt)
        yield jacobian, process_noise(motion, noise)
