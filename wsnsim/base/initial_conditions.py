"""What is random in a run before the clock starts: node positions, sensor traits, trajectories and priors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError
from wsnsim.base.ports import Continuous, Estimate
from wsnsim.base.rng import Streams
from wsnsim.base.setups import NetworkSetup, Setup, TrackingSetup


class InitialConditions(NamedTuple):
    """The network, trajectories and priors of one Monte Carlo run.

    Attributes:
        positions: (N, 2) of the nodes, in m.
        traits: (N, T) constants of the nodes' sensors, such as gains.
        truths: For each target, its states (steps + 1, D).
        priors: For each target, the prior of its filter.
    """

    positions: Floats
    traits: Floats
    truths: list[Floats]
    priors: list[Estimate]


def sample_initial_conditions(setup: TrackingSetup, replicate: int) -> InitialConditions:
    """The initial conditions of one run, from the streams `deploy`, `gains`, `truth` and `prior`.

    Raises:
        RunError: The deployment did not succeed; names seed and replicate.
    """
    streams = Streams(setup.seed, replicate)
    positions = sample_positions(setup, setup.sensor.reach, replicate)
    traits = setup.sensor.draw_traits(len(positions), streams("gains"))
    truth, prior = streams("truth"), streams("prior")
    truths = [motion.truth(setup.steps, setup.dt, truth) for motion in setup.motions]
    return InitialConditions(positions, traits, truths, [setup.prior.draw(states[0], prior) for states in truths])


def sample_positions(setup: Setup, reach: float, replicate: int) -> Floats:
    """Node positions (N, 2) of one run, from the stream `deploy`. `reach`: range in m that covers the field.

    Raises:
        RunError: The deployment did not succeed; names seed and replicate.
    """
    try:
        return setup.deploy.draw(reach, Streams(setup.seed, replicate)("deploy"))
    except RunError as reason:
        raise RunError(f"{reason} (seed {setup.seed}, replicate {replicate})") from reason


def sample_paths(setup: NetworkSetup, truths: Sequence[Floats], replicate: int) -> Sequence[Floats]:
    """The trajectories (steps * polls + 1, D) at the instants at which nodes search for a target.

    A trajectory in continuous time is sampled more finely; other motions are interpolated linearly between steps.
    """
    polls, steps = setup.polls, setup.steps
    if polls == 1:
        return truths
    if all(isinstance(motion, Continuous) for motion in setup.motions):
        stream = Streams(setup.seed, replicate)("truth")
        return [motion.truth(steps * polls, setup.dt / polls, stream) for motion in setup.motions]
    fine, coarse = np.arange(steps * polls + 1) / polls, np.arange(steps + 1)
    return [np.column_stack([np.interp(fine, coarse, column) for column in truth.T]) for truth in truths]
