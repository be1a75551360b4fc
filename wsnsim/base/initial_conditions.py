"""What is random in a run before the clock starts: node positions, sensor traits, trajectories and priors.

`node_names` are the names of nodes by which recorded data refer to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, planar
from wsnsim.base.errors import RunError, plugin_faults_of_run
from wsnsim.base.optional_ports import Continuous, MovesInSpace
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.rng import Streams, derive_all, normals
from wsnsim.base.sensing import HEIGHT, recorded_traits
from wsnsim.base.setups import NetworkSetup, Setup, TrackingSetup


def node_names(setup: Any, nodes: int | None = None) -> tuple[str, ...]:
    """The name of each node: what the deployment calls it (`NamesNodes`), else its number.

    Args:
        setup: the scenario's setup.
        nodes: how many nodes a run has; None: as many as its first run.

    Raises:
        RunError: the deployment cannot tell, such as a file that cannot be read.
    """
    named: tuple[str, ...] | None = getattr(setup.deploy, "names", None)
    if named is not None:
        return named
    if nodes is None:
        reach = setup.sensor.reach if hasattr(setup, "sensor") else setup.link.reach
        nodes = len(setup.deploy.draw(reach, Streams(setup.seed, 0)("deploy")))
    return tuple(map(str, range(nodes)))


class InitialConditions(NamedTuple):
    """The network, trajectories and priors of one Monte Carlo run.

    Attributes:
        positions: (N, 2) where the nodes stand, in m.
        traits: (N, T) constants of the nodes' sensors, such as gains.
        truths: For each target, its states (steps + 1, D).
        priors: For each target, the prior of its filter.
        assumed: (N, 2) positions of the nodes that filters and cluster heads assume, in m.
    """

    positions: Floats
    traits: Floats
    truths: list[Floats]
    priors: list[Estimate]
    assumed: Floats


def sample_initial_conditions(setup: TrackingSetup, replicate: int) -> InitialConditions:
    """The initial conditions of one run, from the streams `deploy`, `gains`, `truth`, `prior` and `position_error`.

    Raises:
        RunError: The deployment did not succeed, or a plug-in failed; names seed and replicate.
    """
    streams = Streams(setup.seed, replicate)
    truth, prior = streams("truth"), streams("prior")
    with plugin_faults_of_run(setup.seed, replicate):
        positions = sample_positions(setup, setup.sensor.reach, replicate)
        traits = with_heights(setup, _traits(setup, len(positions), streams("gains")))
        truths = [motion.truth(setup.steps, setup.dt, truth) for motion in setup.motions]
        priors = [setup.prior.draw(states[0], prior) for states in truths]
    return InitialConditions(positions, traits, truths, priors, assumed_positions(setup, positions, replicate))


def _traits(setup: TrackingSetup, nodes: int, rng: np.random.Generator) -> Floats:
    """(nodes, T) the constants of the nodes' sensors; no gain is sampled where readings were recorded."""
    if setup.recorded is not None:
        return recorded_traits(setup.sensor, nodes, rng)
    return setup.sensor.draw_traits(nodes, rng)


def sample_positions(setup: Setup, reach: float, replicate: int) -> Floats:
    """Node positions (N, 2) of one run, from the stream `deploy`. `reach`: range in m that covers the field.

    Raises:
        RunError: The deployment did not succeed; names seed and replicate.
    """
    try:
        return setup.deploy.draw(reach, Streams(setup.seed, replicate)("deploy"))
    except RunError as reason:
        raise RunError(f"{reason} (seed {setup.seed}, replicate {replicate})") from reason


def with_heights(setup: TrackingSetup, traits: Floats) -> Floats:
    """(N, T) the traits of nodes with the heights that the deployment knows, if the sensor has the trait `height`.

    Raises:
        RunError: the deployment gives no heights.
    """
    names = setup.sensor.trait_names
    if HEIGHT not in names:
        return traits
    heights: Floats | None = getattr(setup.deploy, "heights", None)
    if heights is None:
        raise RunError("deploy: the sensor's law needs the heights of nodes: use kind: file, with a column z")
    result = traits.copy()
    result[:, names.index(HEIGHT)] = heights
    return result


def measured_points(motion: MotionModel, sensor: SensorModel, trajectory: Floats, dt: float) -> Floats:
    """(T, P) the positions of a target that its sensor measures, from its trajectory (T, D) at steps of `dt` s.

    They have a third column, the height, if the sensor has the trait `height` and the target's height is known.
    """
    points = trajectory[:, list(motion.position)]
    if HEIGHT not in sensor.trait_names or not isinstance(motion, MovesInSpace):
        return points
    heights = motion.heights(len(trajectory) - 1, dt)
    return points if heights is None else np.column_stack([planar(points), heights])


def assumed_positions(setup: Setup, positions: Floats, replicate: int) -> Floats:
    """(N, 2) the positions that filters and cluster heads assume of nodes at `positions`, constant over a run.

    Each coordinate has an independent Gaussian error with the standard deviation `deploy.position_error` (our choice).
    The draws of a node are a function of (seed, replicate, node) in the stream `position_error`; without an error the
    array is `positions` itself.
    """
    if not setup.position_error:
        return positions
    keys = derive_all(Streams(setup.seed, replicate).key("position_error"), np.arange(len(positions)))
    errors = np.column_stack([normals(keys, axis) for axis in range(2)])
    assumed: Floats = positions + setup.position_error * errors
    return assumed


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
