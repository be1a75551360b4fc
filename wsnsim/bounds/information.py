"""What readings tell of a position, and who gives one.

    in_range(sensor, points, positions) -> Heard      information(sensor, points, positions, traits, heard) -> (T, P, P)

Fisher's information is the true sensor's, at the truth, and what a variance that depends on the state tells is in it
(see `base.ports.Informs`). That a node has a reading tells where the target is, and so does that a node has none: this
is not counted, so that what follows bounds filters that use nothing but the values of readings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.ports import Detects, SensorModel

STEPS_AT_ONCE = 25
"""Over so few steps a target meets nearly the same nodes (our choice)."""


class Heard(NamedTuple):
    """Whose readings count: pairs of a step and a node, each (n,), the steps ascending."""

    steps: Ints
    nodes: Ints


def in_range(sensor: SensorModel, points: Floats, positions: Floats) -> Heard:
    """Who gets a reading of a target at each of the points (T, P), of nodes at (N, 2)."""
    near = KDTree(positions).query_ball_point(planar(points), sensor.reach, return_sorted=True)
    counts = np.array([len(ids) for ids in near], dtype=np.int64)
    nodes = np.fromiter((node for ids in near for node in ids), np.int64, int(counts.sum()))
    if not isinstance(sensor, Detects):
        return Heard(np.repeat(np.arange(len(points)), counts), nodes)
    some = np.unique(nodes)
    steps, rows = np.nonzero(sensor.detects(points, positions[some]))
    return Heard(steps, some[rows])


def information(sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, heard: Heard) -> Floats:
    """(T, P, P) Fisher's information about the position in all the readings heard at each step."""
    steps, size = points.shape
    total = np.zeros((steps, size, size))
    for first in range(0, steps, STEPS_AT_ONCE):
        begin, end = np.searchsorted(heard.steps, [first, first + STEPS_AT_ONCE])
        nodes, rows = np.unique(heard.nodes[begin:end], return_inverse=True)
        some = np.ascontiguousarray(points[first : first + STEPS_AT_ONCE].T)
        each = sensor.information(some, positions[nodes], traits[nodes])  # type: ignore[attr-defined]
        counted = np.zeros((len(nodes), 1, 1, some.shape[1]), dtype=np.bool_)
        counted[rows, 0, 0, heard.steps[begin:end] - first] = True
        total[first : first + STEPS_AT_ONCE] = np.where(counted, each, 0.0).sum(axis=0).transpose(2, 0, 1)
    return total
