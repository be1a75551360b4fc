"""The error covariances of a bound, from initial conditions and used readings, by the recursion of its kind.

least_covariances(setup, conditions, readings_of, kind, unknown) -> (R, targets, steps, D, D)
along_trajectory(...) -> (T, D, D)      for filters that do not know constants of the nodes: gains, and where they stand

Both constants are sampled once per run. Each constant is a further unknown beside the state. The joint covariance of
all is carried from step to step, so that information about a constant is kept and its correlation with the state
counts. The state's block of it is the inverse of the Schur complement of the constants in the joint information matrix.

The prior of a gain is a Gaussian with the variance of the distribution that gains are sampled from, γ²/3 where it is
uniform: a density with jumps has no Fisher information (our choice). The prior of a node's position is N(a, σ² I) with
the assumed position a: of the true one, an assumed position with the error N(0, σ² I) says just that. The constants of
a node are dropped after its last reading. Bounds are computed at the true gains and positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints, components_of, is_relative, near
from wsnsim.base.initial_conditions import InitialConditions, held
from wsnsim.base.optional_ports import Informs
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.sensing import gain_column
from wsnsim.base.setups import TrackingSetup
from wsnsim.bounds.information import (
    STEPS_PER_BLOCK,
    LinearisedMotion,
    UsedReadings,
    along_trajectories,
    information,
    over_trajectories,
    predicted,
)

GAIN_STEP = 1e-3
"""Gain difference for the numerical derivative: readings are linear in their gain, so any step is exact."""
PLACE_STEP = 1e-3
"""m: difference of a node's position for the numerical derivative, whose relative error is about its square."""


class UnknownConstants(NamedTuple):
    """The variance of the prior of each gain, and of each coordinate (m²) of a node; 0: filters know them."""

    gain: float = 0.0
    place: float = 0.0

    @property
    def variances(self) -> Floats:
        """(C,) the variances of the unknown constants of a node: its gain, then its two coordinates."""
        return np.array([self.gain] * (self.gain > 0.0) + [self.place] * 2 * (self.place > 0.0))


class LinearisedReadings(NamedTuple):
    """The readings z = h · position + k · constants + v at the ground truth, one row per component of a reading.

    Attributes:
        slopes: (n, P) derivatives h of the mean in the position.
        constant_slopes: (n, C) derivatives k of the mean in the unknown constants of the node.
        weights: (n,) information about the mean: 1 / variance of v, with that of a state-dependent variance if a
            reading has one component.
    """

    slopes: Floats
    constant_slopes: Floats
    weights: Floats


def along_trajectory(
    motions: Iterable[LinearisedMotion],
    prior: Floats,
    readings: LinearisedReadings,
    used: UsedReadings,
    place: list[int],
    variances: Floats,
) -> Floats:
    """The covariances of the state along one trajectory, (T, D, D); row 0 is step 1.

    Args:
        motions: the linearised motion model of each step, F as (1, D, D).
        prior: (D, D) covariance at step 0.
        readings: one row per component of a used reading.
        used: step and node of each row; those of step 0 do not count.
        place: the state columns of the position.
        variances: (C,) the prior variances of the unknown constants of a node.
    """
    size, later = len(prior), used.steps > 0
    used = UsedReadings(*(values[later] for values in used))
    readings = LinearisedReadings(*(values[later] for values in readings))
    slots, count = node_slots(used)
    columns = size + slots[:, None] * len(variances) + np.arange(len(variances))
    joint = np.zeros((size + count * len(variances),) * 2)
    joint[:size, :size] = prior
    cuts = np.searchsorted(used.steps, np.arange(1, used.steps.max(initial=0) + 2))
    result = []
    first = np.zeros(len(used.steps), dtype=np.bool_)
    first[np.unique(used.nodes, return_index=True)[1]] = True
    for step, ((jacobian,), noise) in enumerate(motions):
        joint[:size, :size] = predicted(joint[:size, :size], jacobian, noise)
        joint[:size, size:] = jacobian @ joint[:size, size:]
        joint[size:, :size] = joint[:size, size:].T
        if step + 1 < len(cuts):
            now = slice(cuts[step], cuts[step + 1])
            _add_nodes(joint, columns[now][first[now]], variances)
            joint = _updated(joint, LinearisedReadings(*(values[now] for values in readings)), place, columns[now])
        result.append(joint[:size, :size].copy())
    return np.array(result)


def linearised_readings(
    sensor: SensorModel,
    points: Floats,
    positions: Floats,
    traits: Floats,
    used: UsedReadings,
    unknown: UnknownConstants,
) -> tuple[LinearisedReadings, UsedReadings]:
    """The used readings linearised at the target's positions (T, P); and step and node of each row."""
    count, size = len(components_of(sensor)), points.shape[1]
    used_rows = UsedReadings(*(np.repeat(values, count) for values in used))
    total = len(used_rows.steps)
    result = LinearisedReadings(np.empty((total, size)), np.empty((total, unknown.variances.size)), np.empty(total))
    for first in range(0, len(points), STEPS_PER_BLOCK):
        begin, end = np.searchsorted(used.steps, [first, first + STEPS_PER_BLOCK])
        nodes, rows = np.unique(used.nodes[begin:end], return_inverse=True)
        steps, block = used.steps[begin:end] - first, np.ascontiguousarray(points[first : first + STEPS_PER_BLOCK].T)
        where, own, now = positions[nodes], traits[nodes], slice(begin * count, end * count)
        each = (rows[:, None] * count + np.arange(count)).reshape(-1), np.repeat(steps, count)
        _, gradients, variances = sensor.linearise(block, where, own)
        result.slopes[now] = gradients[each[0], :, each[1]]
        for column, (higher, lower, apart) in enumerate(_differences(sensor, where, own, unknown)):
            means = [sensor.linearise(block, *moved)[0] for moved in (higher, lower)]
            difference = near(sensor, means[0], means[1]) - means[1]
            result.constant_slopes[now, column] = difference[each] / apart
        if count > 1:
            result.weights[now] = 1.0 / variances[each]
        else:
            result.weights[now] = _weights(sensor, block, where, own, result.slopes[now], (rows, steps))
    return result, used_rows


def node_slots(used: UsedReadings) -> tuple[Ints, int]:
    """The slot of each row's node in the joint covariance, and the number of slots.

    A node has the same slot from its first reading to its last. Later nodes reuse the slots of those that have no
    further reading, which keeps the matrix small.
    """
    last = dict(zip(used.nodes.tolist(), used.steps.tolist(), strict=True))
    taken: dict[int, int] = {}
    free: list[int] = []
    slots, count = np.empty(len(used.nodes), dtype=np.int64), 0
    leaving: list[tuple[int, int]] = sorted(((step, node) for node, step in last.items()), reverse=True)
    for row, (step, node) in enumerate(zip(used.steps.tolist(), used.nodes.tolist(), strict=True)):
        while leaving and leaving[-1][0] < step:
            free.append(taken[leaving.pop()[1]])
        if node not in taken:
            taken[node] = free.pop() if free else count
            count += taken[node] == count
        slots[row] = taken[node]
    return slots, count


def _differences(
    sensor: SensorModel, positions: Floats, traits: Floats, unknown: UnknownConstants
) -> Iterator[tuple[tuple[Floats, Floats], tuple[Floats, Floats], float]]:
    """For each unknown constant of nodes: positions and traits with more and with less of it, and by how much."""
    if unknown.gain:
        step = np.zeros(traits.shape[1])
        step[gain_column(sensor.trait_names)] = GAIN_STEP
        yield (positions, traits + step), (positions, traits - step), 2.0 * GAIN_STEP
    for axis in range(2 if unknown.place else 0):
        move = PLACE_STEP * np.eye(2)[axis]
        yield (positions + move, traits), (positions - move, traits), 2.0 * PLACE_STEP


def _weights(
    sensor: SensorModel, block: Floats, positions: Floats, traits: Floats, slopes: Floats, which: tuple[Ints, Ints]
) -> Floats:
    """(n,) the information about the mean in readings of one component, by sensors and steps `which`."""
    assert isinstance(sensor, Informs), "a bound is computed only for a sensor model that has an information matrix"
    traces = np.trace(sensor.information(block, positions, traits), axis1=1, axis2=2)[which]
    squared = (slopes**2).sum(axis=1)
    weights: Floats = np.divide(traces, squared, out=np.zeros_like(traces), where=squared > 0.0)
    return weights


def _add_nodes(joint: Floats, columns: Ints, variances: Floats) -> None:
    """Set the constants of newly used nodes to their prior, uncorrelated with everything else; `columns` are (n, C)."""
    rows = columns.reshape(-1)
    joint[rows, :] = 0.0
    joint[:, rows] = 0.0
    joint[rows, rows] = np.tile(variances, len(columns))


def _updated(joint: Floats, readings: LinearisedReadings, place: list[int], constants: Ints) -> Floats:
    """The joint covariance after the readings, whose constants are in the columns (n, C); weight 0: no information."""
    used = readings.weights > 0.0
    slopes, constant_slopes, weights = (values[used] for values in readings)
    constants = constants[used]
    columns = joint[:, place] @ slopes.T + (joint[:, constants] * constant_slopes).sum(axis=2)
    innovation = slopes @ columns[place] + (constant_slopes[:, :, None] * columns[constants]).sum(axis=1)
    innovation += np.diag(1.0 / weights)
    smaller = joint - columns @ np.linalg.solve(innovation, columns.T)
    result: Floats = 0.5 * (smaller + smaller.T)
    return result


ReadingsOf = Callable[[int, int], UsedReadings]
"""(index of the run in the initial conditions, target) -> the readings that the bound uses."""


def least_covariances(
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
    each = range(len(setup.motions))
    along = kind == "per_trajectory"
    return np.stack([_of_target(setup, conditions, readings_of, i, along, unknown, detected) for i in each], axis=1)


def _of_target(
    setup: TrackingSetup,
    conditions: Sequence[InitialConditions],
    readings_of: ReadingsOf,
    target: int,
    along: bool,
    unknown: UnknownConstants,
    detected: float,
) -> Floats:
    """(R, steps, D, D) of one target, by the recursion for filters that know, or do not know, constants of nodes.

    They are NaN where the target is absent. Each time it comes, the recursion begins again from the prior (our choice).
    """
    motion, sensor, variances = setup.motions[target], setup.sensor, unknown.variances
    columns, truths = list(motion.position), np.array([run.truths[target] for run in conditions])
    priors = np.array([run.priors[target].cov for run in conditions])
    places, absent = [held(truth)[:, columns] for truth in truths], np.isnan(truths[:, 1:, 0])
    if along and variances.size:
        if is_relative(sensor):
            raise ValueError("readings of which only the differences count, from nodes whose places are unknown")
        result = []
        for row, run in enumerate(conditions):
            used = readings_of(row, target)
            readings, used = linearised_readings(sensor, places[row], run.positions, run.traits, used, unknown)
            readings = readings._replace(weights=detected * readings.weights)
            motions = _linearised(motion, truths[row : row + 1], priors[row : row + 1], setup.dt)
            result.append(along_trajectory(motions, priors[row], readings, used, columns, variances))
        return np.where(absent[..., None, None], np.nan, np.array(result))
    informations = detected * np.stack([
        information(sensor, places[row], run.positions, run.traits, readings_of(row, target))[1:]
        for row, run in enumerate(conditions)
    ], axis=1)  # fmt: skip
    motions = _linearised(motion, truths, priors, setup.dt)
    if along:
        covariances = along_trajectories(motions, priors, informations, columns).swapaxes(0, 1)
        return np.where(absent[..., None, None], np.nan, covariances)
    return over_trajectories(motions, priors, informations, columns)[None]


def _linearised(motion: MotionModel, truths: Floats, priors: Floats, dt: float) -> Iterator[LinearisedMotion]:
    """The motion model linearised at the trajectories, step by step; without noise where only filters assume it.

    Where a target comes, nothing is known of it but its prior.
    """
    there, states = np.isfinite(truths[..., 0]), np.array([held(truth) for truth in truths])
    for step in range(truths.shape[1] - 1):
        jacobian, noise = motion.matrices(np.ascontiguousarray(states[:, step].T), dt, step * dt)
        noise = noise if getattr(motion, "truth_noise", True) else np.zeros_like(noise)
        comes = (there[:, step + 1] & ~there[:, step])[:, None, None]
        if comes.any():
            jacobian, noise = np.where(comes, 0.0, jacobian), np.where(comes, priors, noise)
        yield jacobian, noise
