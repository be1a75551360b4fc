"""What a replicate drew before its clock started, and whether that is a draw of the motion that bounds are made from.

drawn(problem, replicate) -> Drawn      objection(motion, kind) -> why there is no bound, or ''
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Continuous, MotionModel
from wsnsim.base.rng import Streams
from wsnsim.base.setups import TrackingSetup


class Drawn(NamedTuple):
    """Positions (N, 2) and traits (N, T) of the nodes, the truth (steps + 1, D) and prior covariance of each target."""

    positions: Floats
    traits: Floats
    truths: list[Floats]
    priors: list[Floats]


def drawn(problem: TrackingSetup, replicate: int) -> Drawn:
    """The same network and targets as `experiment.simulate` has, from the same streams."""
    streams = Streams(problem.seed, replicate)
    positions = problem.deploy.draw(problem.sensor.reach, streams("deploy"))
    traits = problem.sensor.draw_traits(len(positions), streams("gains"))
    truth, prior = streams("truth"), streams("prior")
    truths = [motion.truth(problem.steps, problem.dt, truth) for motion in problem.motions]
    return Drawn(positions, traits, truths, [problem.prior.draw(states[0], prior).cov for states in truths])


def objection(motion: MotionModel, kind: str) -> str:
    """Why there is no bound of this kind on the error of a target that moves so; empty if there is one.

    What a mean of trajectories bounds are the errors for draws of the motion. Along one trajectory, the motion only
    says how fast the past is forgotten.
    """
    if isinstance(motion, Continuous):
        return "the target goes straight from point to point, and its motion has no density"
    if kind == "per_trajectory":
        return ""
    course = getattr(motion, "course", "free")
    if course == "in_room":
        return "truths are drawn on condition that they stay in a room: they are no draws of the motion"
    if course != "free":
        return f"the truth is made to {course}: it is no draw of the motion"
    if getattr(motion, "box", None) is not None:
        return "the truth is kept in a box, of which the motion that filters are told says nothing"
    return ""


def process_noise(motion: MotionModel, covariance: Floats) -> Floats:
    """The process covariance (D, D) of the truth: zero where it moves without the noise that filters believe in."""
    return covariance if getattr(motion, "truth_noise", True) else np.zeros_like(covariance)


def cautions(problem: TrackingSetup, draws: Sequence[Drawn]) -> Iterator[str]:
    """What makes a bound less than strict for these runs, each in a sentence."""
    prior: Any = problem.prior
    if getattr(prior, "mean", None) is not None and any(_starts_elsewhere(prior, m) for m in problem.motions):
        yield "filters are told a fixed prior: the bound holds on average over starts drawn from it"
    yield from sorted({objection(motion, "unconditional") for motion in problem.motions} - {""})
    for target, motion in enumerate(problem.motions):
        bound = getattr(motion, "bound", None)
        places = np.array([one.truths[target][:, list(motion.position)] for one in draws])
        if bound is not None and np.any(np.abs(places) > bound):
            yield "the target is turned back at a line: what its sudden turn tells of its place is not counted"
            return


def _starts_elsewhere(prior: Any, motion: Any) -> bool:
    """Whether truths do not start as the prior says."""
    spread = getattr(motion, "start_sd", None)
    return spread is None or not np.allclose(spread, prior.sd) or not np.allclose(motion.start, prior.mean)
