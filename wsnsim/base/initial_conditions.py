"""What is random in a run before the clock starts: node positions, sensor traits, trajectories and priors.

`node_names` are the names of nodes by which recorded data refer to them. A `StandaloneBlock` is what a tracker is given
of many runs without a network, which it may make at once: R runs, each one target of one Monte Carlo run, of K steps
with S sensors and D state columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, Ints, Keys, planar, rounding
from wsnsim.base.errors import RunError, plugin_faults_of_run, shortened
from wsnsim.base.optional_ports import Continuous, MovesInSpace
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.rng import derive_all, normals
from wsnsim.base.sensing import HEIGHT, recorded_traits
from wsnsim.base.setups import Intervals, NetworkSetup, Setup, TrackingSetup


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
        nodes = len(setup.deploy.draw(reach, setup.streams(0)("deploy")))
    return tuple(map(str, range(nodes)))


def joined_by_name(
    names: Sequence[str],
    known: Sequence[str],
    who: str,
    whose: str,
    columns: Callable[[], Mapping[str, Sequence[str]]] = dict,
) -> Ints:
    """(n,) the number among `known` of each of the names of nodes, -1 for one that is not there.

    Every join of two data sets about the same nodes is made by this function.

    Args:
        names: the names in one of them, each once.
        known: the names in the other, each once.
        who: what the first is called in the message.
        whose: what the second is called.
        columns: gives the cells of other columns, by their names, that may be meant.

    Raises:
        RunError: they have not one name in common; the message shows both, and the columns that have some.
    """
    number = {name: node for node, name in enumerate(known)}
    found = np.array([number.get(name, -1) for name in names], dtype=np.int64)
    if len(found) and (found < 0).all():
        shown = "; ".join(shortened(", ".join(each)) for each in (names, known))
        near = [f"the column '{name}' has some" for name, cells in columns().items() if {*cells} & {*names, *known}]
        raise RunError("; ".join([f"{who} and {whose} have no name of a node in common: {shown}", *near]))
    return found


class InitialConditions(NamedTuple):
    """The network, trajectories and priors of one Monte Carlo run.

    Attributes:
        positions: (N, 2) where the nodes stand, in m.
        traits: (N, T) constants of the nodes' sensors, such as gains.
        truths: For each target, its states (steps + 1, D); NaN at steps at which it is absent.
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
    streams = setup.streams(replicate)
    truth, prior = streams("truth"), streams("prior")
    with plugin_faults_of_run(setup.seed, replicate):
        positions = sample_positions(setup, setup.sensor.reach, replicate)
        traits = with_heights(setup, _traits(setup, len(positions), streams("gains")))
        truths = _trajectories(setup, setup.steps, setup.dt, truth)
        priors = [setup.prior.draw(held(states)[0], prior) for states in truths]
    return InitialConditions(positions, traits, truths, priors, assumed_positions(setup, positions, replicate))


def _trajectories(setup: TrackingSetup, steps: int, dt: float, rng: np.random.Generator) -> list[Floats]:
    """The trajectory (steps + 1, D) of each target, NaN where the target is absent."""
    times: Floats = np.arange(steps + 1, dtype=np.float64) * dt
    found = []
    for motion, intervals in zip(setup.motions, setup.presence or [None] * len(setup.motions), strict=True):
        states = motion.truth(steps, dt, rng)
        if intervals is not None:
            states = np.where(present_at(times, intervals)[:, None], states, np.nan)
        found.append(states)
    return found


def present_at(times: Floats, intervals: Intervals) -> Bools:
    """(n,) whether a target of these intervals of presence, ends included, is there at instants (n,) in s."""
    begins, ends = np.reshape(intervals, (-1, 2, 1)).swapaxes(0, 1)
    equal = rounding(np.diff(times[:2]).min(initial=np.inf))
    within: Bools = np.any((times >= begins - equal) & (times <= ends + equal), axis=0)
    return within


def held(states: Floats) -> Floats:
    """States, or points, (T, D) without absences: the last one, or the first, stands for those that are NaN.

    They are 0 where the target never exists.
    """
    there = np.isfinite(states[:, 0])
    last = np.maximum.accumulate(np.where(there, np.arange(len(states)), there.argmax()))
    return np.nan_to_num(states[last])


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
        return setup.deploy.draw(reach, setup.streams(replicate)("deploy"))
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
    keys = derive_all(setup.streams(replicate).key("position_error"), np.arange(len(positions)))
    errors = np.column_stack([normals(keys, axis) for axis in range(2)])
    return positions + setup.position_error * errors


def sample_paths(setup: NetworkSetup, truths: Sequence[Floats], replicate: int) -> Sequence[Floats]:
    """The trajectories (steps * polls + 1, D) at the instants at which nodes search for a target.

    A trajectory in continuous time is sampled more finely; other motions are interpolated linearly between steps.
    """
    polls, steps = setup.polls, setup.steps
    if polls == 1:
        return truths
    if all(isinstance(motion, Continuous) for motion in setup.motions):
        return _trajectories(setup, steps * polls, setup.dt / polls, setup.streams(replicate)("truth"))
    fine, coarse = np.arange(steps * polls + 1) / polls, np.arange(steps + 1)
    return [np.column_stack([np.interp(fine, coarse, column) for column in truth.T]) for truth in truths]


class StandaloneRun(NamedTuple):
    """One target of one run, as a standalone filter sees it.

    Attributes:
        prior: The prior of the filter.
        readings: (K + 1, S) measurements of the steps 0 to K; NaN where a sensor has none.
        positions: (S, 2) assumed positions of the sensors, in m.
        traits: (S, T) constants of the sensors.
        keys: (K + 1,) counter key of the head at each step, as `Scene.key`.
    """

    prior: Estimate
    readings: Floats
    positions: Floats
    traits: Floats
    keys: Keys


@dataclass(frozen=True, slots=True)
class StandaloneBlock:
    """Runs that have everything else in common.

    Attributes:
        runs: the R runs.
        motion: the motion model that the filter assumes.
        sensor: the sensor model that the filter assumes.
        steps: K, the number of steps.
        dt: the length of a step in s.
    """

    runs: Sequence[StandaloneRun]
    motion: MotionModel
    sensor: SensorModel
    steps: int
    dt: float


class BlockEstimates(NamedTuple):
    """The estimates of all runs of a block at the steps 1 to K.

    Attributes:
        means: (R, K, D).
        covs: (R, K, D, D).
        effective: (R, K) effective numbers of particles; NaN without particles.
        nis: (R, K) normalised innovations squared; NaN without an innovation.
        nis_dof: (R, K) their degrees of freedom.
        cycles: (R,) operations of the head, those of the start included.
    """

    means: Floats
    covs: Floats
    effective: Floats
    nis: Floats
    nis_dof: Ints
    cycles: Floats


@runtime_checkable
class WholeRuns(Protocol):
    """Optional port of a tracker: many standalone runs in one call, without requests.

    Readings have one component, which may be an angle; runs whose readings have several are made request by request.
    It is for trackers whose members send one reading in one packet at each step, to a head that does the rest. Each run
    must not depend on the other runs of the block, and must equal the run that `start` and `step` make: `check_tracker`
    compares them.
    """

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """The estimates of all runs of a block; None if the tracker's present options are not offered."""


def offers_whole_runs(tracker: object) -> bool:
    """Whether a tracker has the port `WholeRuns`, and `whole_runs` knows all of its methods.

    A subclass that has a method or a property of its own, and inherits `whole_runs`, may do something else in `step`.
    """
    for kind in type(tracker).__mro__:
        if "whole_runs" in vars(kind):
            return True
        if any(hasattr(value, "__get__") and not name.startswith("__") for name, value in vars(kind).items()):
            return False
    return False
