"""The bound for filters that do not know the nodes' gains, which are sampled once per run and constant.

    along_trajectory(...) -> (T, D, D)

Each gain is a further unknown beside the state. The joint covariance of both is carried from step to step, so that
information about a gain is kept and its correlation with the state counts. The state's block of it is the inverse of
the Schur complement of the gains in the joint information matrix.

The prior of a gain is a Gaussian with the variance of the distribution that gains are sampled from, γ²/3 where it is
uniform: a density with jumps has no Fisher information (our choice). A gain is dropped after its node's last reading.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.ports import Informs, SensorModel
from wsnsim.base.traits import gain_column
from wsnsim.bounds.information import STEPS_PER_BLOCK, UsedReadings
from wsnsim.bounds.recursion import LinearisedMotion, predicted

GAIN_STEP = 1e-3
"""Gain difference for the numerical derivative: readings are linear in their gain, so any step is exact."""


class LinearisedReadings(NamedTuple):
    """The readings z = h · position + k · gain + v at the ground truth, one row per reading.

    Attributes:
        slopes: (n, P) derivatives h of the mean in the position.
        gain_slopes: (n,) derivatives k of the mean in the gain.
        weights: (n,) information about the mean, 1 / variance of v, that of a state-dependent variance included.
    """

    slopes: Floats
    gain_slopes: Floats
    weights: Floats


def along_trajectory(
    motions: Iterable[LinearisedMotion],
    prior: Floats,
    readings: LinearisedReadings,
    used: UsedReadings,
    place: list[int],
    variance: float,
) -> Floats:
    """The covariances of the state along one trajectory, (T, D, D); row 0 is step 1.

    Args:
        motions: the linearised motion model of each step, F as (1, D, D).
        prior: (D, D) covariance at step 0.
        readings: one row per used reading.
        used: step and node of each reading; those of step 0 do not count.
        place: the state columns of the position.
        variance: the variance of the gains.
    """
    size, later = len(prior), used.steps > 0
    used = UsedReadings(*(values[later] for values in used))
    readings = LinearisedReadings(*(values[later] for values in readings))
    slots, count = gain_slots(used)
    joint = np.zeros((size + count, size + count))
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
            _add_gains(joint, size + slots[now][first[now]], variance)
            joint = _updated(joint, LinearisedReadings(*(values[now] for values in readings)), place, size + slots[now])
        result.append(joint[:size, :size].copy())
    return np.array(result)


def linearised_readings(
    sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, used: UsedReadings
) -> LinearisedReadings:
    """The used readings linearised at the target's positions (T, P); each is a scalar with a gain."""
    assert isinstance(sensor, Informs), "a bound is computed only for a sensor model that has an information matrix"
    column = gain_column(sensor.trait_names)
    result = LinearisedReadings(np.empty((len(used.steps), points.shape[1])), *np.empty((2, len(used.steps))))
    for first in range(0, len(points), STEPS_PER_BLOCK):
        begin, end = np.searchsorted(used.steps, [first, first + STEPS_PER_BLOCK])
        nodes, rows = np.unique(used.nodes[begin:end], return_inverse=True)
        steps, block = used.steps[begin:end] - first, np.ascontiguousarray(points[first : first + STEPS_PER_BLOCK].T)
        where, own = positions[nodes], traits[nodes]
        more, less = own.copy(), own.copy()
        more[:, column] += GAIN_STEP
        less[:, column] -= GAIN_STEP
        _, gradients, _ = sensor.linearise(block, where, own)
        each = sensor.information(block, where, own)
        higher, lower = (sensor.linearise(block, where, traits)[0] for traits in (more, less))
        result.slopes[begin:end] = gradients[rows, :, steps]
        squared = (result.slopes[begin:end] ** 2).sum(axis=1)
        traces = np.trace(each, axis1=1, axis2=2)[rows, steps]
        result.weights[begin:end] = np.divide(traces, squared, out=np.zeros_like(traces), where=squared > 0.0)
        result.gain_slopes[begin:end] = (higher - lower)[rows, steps] / (2.0 * GAIN_STEP)
    return result


def gain_slots(used: UsedReadings) -> tuple[Ints, int]:
    """The slot of each reading's gain in the joint covariance, and the number of slots.

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


def _add_gains(joint: Floats, rows: Ints, variance: float) -> None:
    """Set the gains of newly used nodes to their prior, uncorrelated with everything else."""
    joint[rows, :] = 0.0
    joint[:, rows] = 0.0
    joint[rows, rows] = variance


def _updated(joint: Floats, readings: LinearisedReadings, place: list[int], slots: Ints) -> Floats:
    """The joint covariance after the readings; those of weight 0 carry no information."""
    used = readings.weights > 0.0
    slopes, gain_slopes, weights = (values[used] for values in readings)
    slots = slots[used]
    columns = joint[:, place] @ slopes.T + joint[:, slots] * gain_slopes
    innovation = slopes @ columns[place] + gain_slopes[:, None] * columns[slots] + np.diag(1.0 / weights)
    smaller = joint - columns @ np.linalg.solve(innovation, columns.T)
    result: Floats = 0.5 * (smaller + smaller.T)
    return result
