"""Shadowing of sampled readings, correlated along a target's path.

path_shadowing(sensor, points, key) -> PathShadowing | None      shadowing.at(steps, nodes) -> (n,)
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.optional_ports import IsShadowed
from wsnsim.base.ports import SensorModel
from wsnsim.base.rng import derive_all, derive_each, normals

WHITE: Final = 3
"""The draw of the key of (target, step, node) that shadowing takes; noise and detection take earlier ones."""


class PathShadowing:
    """What shadowing adds to the readings of one target: a Gauss-Markov process per node along the target's path.

    Its variance is σ², and the correlation of two steps exp(-d/δ), with the length d of the path between them. While
    the target rests it stays as it is. A target that returns to a place does not find the same shadowing there: this is
    a process, not a map. The draws of a node are a function of (key, step, node): they depend neither on the other
    nodes nor on who is awake. Between steps it is interpolated linearly (our choice), where nodes search more often.

    Source: Gudmundson (1991), whose correlation is a power of the distance; the rest is our choice.

    Args:
        sensor: σ and δ.
        points: (T, P) position of the target at each instant; every `instants`-th is a step.
        key: `derive(streams.key("sense"), target)`.
        instants: how many instants a step has.
    """

    def __init__(self, sensor: IsShadowed, points: Floats, key: int, instants: int = 1) -> None:
        steps = points[::instants]
        moved = np.linalg.norm(np.diff(steps, axis=0), axis=1) / sensor.decorrelation
        self._kept, self._new = np.exp(-moved), np.sqrt(-np.expm1(-2.0 * moved))
        self._sd, self._instants = sensor.shadowing, instants
        self._keys = derive_all(key, np.arange(len(steps)))
        self._columns: dict[int, int] = {}
        self._values = np.empty((len(steps), 0))

    def at(self, instants: Ints, nodes: Ints) -> Floats:
        """(n,) what is added to the reading of each node at each instant, both (n,)."""
        self._add(nodes)
        columns = np.array([self._columns[node] for node in nodes.tolist()], dtype=np.int64)
        steps, part = np.divmod(instants, self._instants)
        now: Floats = self._values[steps, columns]
        if self._instants == 1:
            return now
        share, later = part / self._instants, np.minimum(steps + 1, len(self._values) - 1)
        between: Floats = now + share * (self._values[later, columns] - now)
        return between

    def _add(self, nodes: Ints) -> None:
        """Compute the process of nodes that were not asked for yet."""
        new = [node for node in np.unique(nodes).tolist() if node not in self._columns]
        if not new:
            return
        keys = derive_each(self._keys[:, None], np.array(new, dtype=np.uint64)[None, :])
        values = self._sd * normals(keys, WHITE)
        for step in range(1, len(values)):
            values[step] = self._kept[step - 1] * values[step - 1] + self._new[step - 1] * values[step]
        self._columns.update({node: len(self._columns) + place for place, node in enumerate(new)})
        self._values = np.concatenate([self._values, values], axis=1)


def path_shadowing(sensor: SensorModel, points: Floats, key: int, instants: int = 1) -> PathShadowing | None:
    """The shadowing of a target's readings; None if the sensor model has none. Arguments as of `PathShadowing`."""
    if not isinstance(sensor, IsShadowed) or not sensor.shadowing:
        return None
    return PathShadowing(sensor, points, key, instants)
