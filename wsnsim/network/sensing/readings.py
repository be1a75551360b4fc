"""The readings of sensors without imperfections: which nodes measure a target at each step, and the values.

    readings.readings(step) -> {node: reading}      readings.appeared(step), readings.vanished(step) -> [node, ...]

It is known which target each reading belongs to (our choice: no data association). A reading is a function
of (seed, run, target, step, node), so it does not depend on which nodes are awake to take it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.ports import Detects, SensorModel
from wsnsim.base.rng import derive, reading_noise


@dataclass(frozen=True, slots=True)
class SensorArray:
    """The sensors of all nodes: positions (N, 2), traits such as gains (N, T), sensor model, and key of the noise."""

    positions: Floats
    traits: Floats
    model: SensorModel
    tree: KDTree
    key: int


class Readings:
    """The readings of one target, computed for the whole trajectory at once. Steps run from 0 to `len(points) - 1`.

    Args:
        sensors: The sensors of all nodes.
        target: Number of the target.
        points: Its positions (steps, P).
    """

    def __init__(self, sensors: SensorArray, target: int, points: Floats) -> None:
        model, positions = sensors.model, sensors.positions
        found = sensors.tree.query_ball_point(planar(points), model.reach, return_sorted=True)
        if isinstance(model, Detects):
            found = [_detecting(model, point, ids, positions) for point, ids in zip(points, found, strict=True)]
        counts = np.array([len(ids) for ids in found], dtype=np.int64)
        nodes = np.fromiter((node for ids in found for node in ids), np.int64, int(counts.sum()))
        steps = np.repeat(np.arange(len(points)), counts)
        noise = reading_noise(derive(sensors.key, target), steps, nodes)
        readings = model.measure(points[steps], positions[nodes], sensors.traits[nodes], noise)
        cuts = np.concatenate(([0], np.cumsum(counts))).tolist()
        values: list[float] = readings.tolist()
        self.ids: list[list[int]] = [list(ids) for ids in found]
        self._values = [values[a:b] for a, b in itertools.pairwise(cuts)]

    def readings(self, step: int) -> dict[int, float]:
        """{node: reading} of the nodes that measure the target at a step, ascending, whether they are up or not."""
        return dict(zip(self.ids[step], self._values[step], strict=True))

    def appeared(self, step: int) -> list[int]:
        """Nodes that measure the target at this step but did not at the previous one, ascending."""
        before = set(self._ids_at(step - 1)) if step else set()
        return [node for node in self._ids_at(step) if node not in before]

    def vanished(self, step: int) -> list[int]:
        """Nodes that measured the target at the previous step but do not at this one, ascending."""
        now = set(self._ids_at(step))
        return [node for node in self._ids_at(step - 1) if node not in now] if step else []

    def _ids_at(self, step: int) -> Iterable[int]:
        """The nodes that measure the target at a step, ascending."""
        return self.ids[step]


def _detecting(model: Detects, point: Floats, ids: list[int], positions: Floats) -> list[int]:
    """The nodes whose sensor detects a target at a point; `ids` are the nodes within sensing range."""
    detected = model.detects(point[None], positions[ids])[0]
    return [node for node, yes in zip(ids, detected.tolist(), strict=True) if yes]
