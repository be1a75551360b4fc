"""The covariances behind a bound: what was drawn, what the readings tell, and the recursion that fits.

covariances(problem, draws, heard, kind, gains) -> (R, targets, steps, D, D)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel
from wsnsim.base.setups import TrackingSetup
from wsnsim.bounds import gains as of_gains
from wsnsim.bounds.information import Heard, information
from wsnsim.bounds.initial_draws import Drawn, process_noise
from wsnsim.bounds.recursion import Law, along_trajectories, over_trajectories

Hearing = Callable[[int, int], Heard]
"""(place of a replicate among the draws, target) -> whose readings count."""


def covariances(
    problem: TrackingSetup, draws: Sequence[Drawn], hearing: Hearing, kind: str, gains: str, taken: float = 1.0
) -> Floats:
    """(R, targets, steps, D, D): R is the number of draws per trajectory, and 1 if unconditional.

    `taken`: the probability that a reading in range is taken, at random: so much of its information is there on the
    average. Raises ValueError with the reason if there is no bound.
    """
    along = kind == "per_trajectory"
    if along and gains == "unknown" and of_gains.has_gains(problem.sensor):
        made = [_with_gains(problem, draws, hearing, target, taken) for target in range(len(problem.motions))]
    else:
        made = [_with_known_gains(problem, draws, hearing, target, along, taken)
                for target in range(len(problem.motions))]  # fmt: skip
    return np.stack(made, axis=1)


def _with_known_gains(
    problem: TrackingSetup, draws: Sequence[Drawn], hearing: Hearing, target: int, along: bool, taken: float
) -> Floats:
    """(R, steps, D, D) of one target."""
    motion, truths, priors = _of_target(problem, draws, target)
    place = list(motion.position)
    told = np.stack([
        information(problem.sensor, truth[:, place], one.positions, one.traits, hearing(row, target))[1:]
        for row, (one, truth) in enumerate(zip(draws, truths, strict=True))
    ], axis=1)  # fmt: skip
    law = _law(motion, truths, problem.dt)
    if along:
        return along_trajectories(law, priors, taken * told, place).swapaxes(0, 1)
    return over_trajectories(law, priors, taken * told, place)[None]


def _with_gains(problem: TrackingSetup, draws: Sequence[Drawn], hearing: Hearing, target: int, taken: float) -> Floats:
    """(R, steps, D, D) of one target, by filters that do not know the gains."""
    motion, truths, priors = _of_target(problem, draws, target)
    place, made = list(motion.position), []
    for row, (one, truth) in enumerate(zip(draws, truths, strict=True)):
        heard = hearing(row, target)
        told = of_gains.told_by(problem.sensor, truth[:, place], one.positions, one.traits, heard)
        told = told._replace(weights=taken * told.weights)
        law = _law(motion, truth[None], problem.dt)
        spread = problem.sensor.gain_spread  # type: ignore[attr-defined]
        made.append(of_gains.along_trajectory(law, priors[row], told, heard, place, spread))
    return np.array(made)


def _of_target(problem: TrackingSetup, draws: Sequence[Drawn], target: int) -> tuple[MotionModel, Floats, Floats]:
    """Its motion, its truths (R, steps + 1, D) and prior covariances (R, D, D)."""
    truths = np.array([one.truths[target] for one in draws])
    return problem.motions[target], truths, np.array([one.priors[target] for one in draws])


def _law(motion: MotionModel, truths: Floats, dt: float) -> Iterator[Law]:
    """F (R, D, D) at the truths and the truth's Q (D, D), of each step in turn."""
    for step in range(truths.shape[1] - 1):
        slopes, noise = motion.matrices(np.ascontiguousarray(truths[:, step].T), dt, step * dt)
        yield slopes, process_noise(motion, noise)
