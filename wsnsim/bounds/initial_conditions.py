"""Which bounds the initial conditions of a scenario allow.

reason_without_bound(motion, kind) -> text or ''      cautions(setup, conditions), cautions_of_readings(setup) -> texts
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.optional_ports import Continuous, IsShadowed
from wsnsim.base.ports import MotionModel
from wsnsim.base.setups import TrackingSetup

FAULTLESS: Final = "faults are not counted: the bound for readings in range is that without faults"


def reason_without_bound(motion: MotionModel, kind: str) -> str:
    """Why there is no bound of this kind for a target with this motion model; empty if there is one.

    The posterior bound holds for trajectories sampled from the motion model that filters are given. Along one
    trajectory, the motion model only determines how fast past information decays.
    """
    if getattr(motion, "recorded", False):
        return "the trajectory was recorded: it is no sample of a motion model"
    if isinstance(motion, Continuous):
        return "the target moves in straight lines between way-points: its motion has no probability density"
    if kind == "per_trajectory":
        return ""
    course = getattr(motion, "course", "free")
    if course == "in_room":
        return "trajectories are conditioned on staying in a room: they are not samples of the motion model"
    if course != "free":
        return f"the trajectory has a prescribed {course}: it is not a sample of the motion model"
    if getattr(motion, "box", None) is not None:
        return "the trajectory is reflected at a box that is not part of the motion model of the filters"
    return ""


def process_noise(motion: MotionModel, covariance: Floats) -> Floats:
    """The covariance (D, D) of the trajectory's process noise: zero where only the filters assume noise."""
    return covariance if getattr(motion, "truth_noise", True) else np.zeros_like(covariance)


def cautions(setup: TrackingSetup, conditions: Sequence[InitialConditions], places_known: bool = True) -> Iterator[str]:
    """The reasons why a bound is not strict for these runs, a sentence each.

    `places_known`: whether the bound takes the positions of nodes as known.
    """
    prior: Any = setup.prior
    if getattr(prior, "mean", None) is not None and any(_starts_elsewhere(prior, m) for m in setup.motions):
        yield "filters are given a fixed prior: the bound holds on average over starts sampled from it"
    yield from sorted({reason_without_bound(motion, "unconditional") for motion in setup.motions} - {""})
    if getattr(setup.sensor, "beyond", "") == "noise" and math.isfinite(setup.sensor.reach):
        yield "sensors out of range read noise, which tells where the target is not: the bound does not count that"
    yield from cautions_of_readings(setup)
    if setup.position_error and places_known:
        yield "the bound takes node positions as known: the filters have only assumed ones (deploy.position_error)"
    for target, motion in enumerate(setup.motions):
        bound = getattr(motion, "bound", None)
        positions = np.array([one.truths[target][:, list(motion.position)] for one in conditions])
        if bound is not None and np.any(np.abs(positions) > bound):
            yield "the target turns back at a line: the information in that sudden turn is not counted"
            return


def cautions_of_readings(setup: TrackingSetup) -> Iterator[str]:
    """Those of the cautions that are about readings: what the bound takes to be otherwise than it is."""
    if setup.faults:
        yield FAULTLESS
    if setup.recorded is not None:
        yield "readings were recorded: the bound is that of the law (sensor.law), which they need not follow"
    elif isinstance(setup.sensor, IsShadowed) and setup.sensor.shadowing:
        yield "shadowing correlates readings along the path: the bound takes them as independent, without shadowing"


def _starts_elsewhere(prior: Any, motion: Any) -> bool:
    """Whether trajectories do not start at samples of the prior."""
    spread = getattr(motion, "start_sd", None)
    return spread is None or not np.allclose(spread, prior.sd) or not np.allclose(motion.start, prior.mean)
