"""Who can sense which target when, and what it would read: one k-d tree query for a whole trajectory.

Readings are a function of (seed, replicate, target, step, node), so they do not depend on who is awake to take them.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.ports import Detects, SensorModel
from wsnsim.base.rng import derive, reading_noise


class Sensed:
    """What there is to sense of one target. Steps run from 0 to `len(points) - 1`."""

    def __init__(
        self,
        target: int,
        points: Floats,
        positions: Floats,
        traits: Floats,
        sensor: SensorModel,
        tree: KDTree,
        key: int,
    ) -> None:
        found = tree.query_ball_point(planar(points), sensor.reach, return_sorted=True)
        if isinstance(sensor, Detects):
            found = [_detecting(sensor, point, ids, positions) for point, ids in zip(points, found, strict=True)]
        counts = np.array([len(ids) for ids in found], dtype=np.int64)
        nodes = np.fromiter((node for ids in found for node in ids), np.int64, int(counts.sum()))
        steps = np.repeat(np.arange(len(points)), counts)
        noise = reading_noise(derive(key, target), steps, nodes)
        readings = sensor.measure(points[steps], positions[nodes], traits[nodes], noise)
        cuts = np.concatenate(([0], np.cumsum(counts))).tolist()
        values: list[float] = readings.tolist()
        self.ids: list[list[int]] = [list(ids) for ids in found]
        self._values = [values[a:b] for a, b in itertools.pairwise(cuts)]

    def readings(self, step: int) -> dict[int, float]:
        """{node: reading} of every node in range at a step, living or dead, ascending."""
        return dict(zip(self.ids[step], self._values[step], strict=True))

    def appeared(self, step: int) -> list[int]:
        """Nodes in range at this step that were not at the one before, ascending."""
        before = set(self.ids[step - 1]) if step else set()
        return [node for node in self.ids[step] if node not in before]

    def vanished(self, step: int) -> list[int]:
        """Nodes in range at the step before that are no longer, ascending."""
        now = set(self.ids[step])
        return [node for node in self.ids[step - 1] if node not in now] if step else []


def _detecting(sensor: Detects, point: Floats, ids: list[int], positions: Floats) -> list[int]:
    """Those of the nodes within reach whose sensor says that it gets a reading."""
    heard = sensor.detects(point[None], positions[ids])[0]
    return [node for node, yes in zip(ids, heard.tolist(), strict=True) if yes]
