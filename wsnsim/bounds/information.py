"""Fisher information of the readings about a target's position, and which nodes have a reading.

    in_range(sensor, points, positions) -> UsedReadings
    information(sensor, points, positions, traits, used) -> (T, P, P)

The information is evaluated at the ground truth with the true sensor model, and includes what a state-dependent
variance contributes (see `base.ports.Informs`). Whether a node has a reading at all also depends on the target's
position. This is not counted: the bound is for filters that use the values of readings only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.ports import Detects, Informs, SensorModel

STEPS_PER_BLOCK = 25
"""Steps computed together: a target meets nearly the same nodes within them (our choice)."""


class UsedReadings(NamedTuple):
    """The readings that count, as pairs of a step and a node.

    Attributes:
        steps: (n,) in ascending order.
        nodes: (n,) node numbers.
    """

    steps: Ints
    nodes: Ints


def in_range(sensor: SensorModel, points: Floats, positions: Floats) -> UsedReadings:
    """The readings of all nodes that detect a target.

    Args:
        sensor: the sensor model.
        points: (T, P) the target's position at each step.
        positions: (N, 2) of the nodes.
    """
    steps, nodes = CellGrid(positions).within_each(planar(points), sensor.reach)
    if not isinstance(sensor, Detects):
        return UsedReadings(steps, nodes)
    candidates = np.unique(nodes)
    steps, rows = np.nonzero(sensor.detects(points, positions[candidates]))
    return UsedReadings(steps, candidates[rows])


def information(sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, used: UsedReadings) -> Floats:
    """The Fisher information about the position in all used readings of each step, (T, P, P)."""
    assert isinstance(sensor, Informs), "a bound is computed only for a sensor model that has an information matrix"
    steps, size = points.shape
    total = np.zeros((steps, size, size))
    for first in range(0, steps, STEPS_PER_BLOCK):
        begin, end = np.searchsorted(used.steps, [first, first + STEPS_PER_BLOCK])
        nodes, rows = np.unique(used.nodes[begin:end], return_inverse=True)
        block = np.ascontiguousarray(points[first : first + STEPS_PER_BLOCK].T)
        each = sensor.information(block, positions[nodes], traits[nodes])
        counted = np.zeros((len(nodes), 1, 1, block.shape[1]), dtype=np.bool_)
        counted[rows, 0, 0, used.steps[begin:end] - first] = True
        total[first : first + STEPS_PER_BLOCK] = np.where(counted, each, 0.0).sum(axis=0).transpose(2, 0, 1)
    return total
