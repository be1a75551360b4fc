"""The readings of sensors without imperfections: which nodes measure a target at each step, and the values.

    readings.readings(step) -> {node: reading}      readings.appeared(step), readings.vanished(step) -> [node, ...]

It is known which target each reading belongs to (our choice: no data association). A reading is a function
of (seed, run, target, step, node), so it does not depend on which nodes are awake to take it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, planar
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.ports import Detects, SensorModel
from wsnsim.base.rng import derive, reading_noise
from wsnsim.base.sensing import PathShadowing
from wsnsim.base.vector_readings import Reading, as_readings, components_of


@dataclass(frozen=True, slots=True)
class SensorArray:
    """The sensors of all nodes: positions (N, 2), traits such as gains (N, T), sensor model, and key of the noise."""

    positions: Floats
    traits: Floats
    model: SensorModel
    grid: CellGrid
    key: int


class Readings:
    """The readings of one target, computed for the whole trajectory at once. Steps run from 0 to `len(points) - 1`.

    Args:
        sensors: The sensors of all nodes.
        target: Number of the target.
        points: Its positions (steps, P).
        shadowing: What shadowing adds to the readings; None: nothing.
    """

    def __init__(
        self, sensors: SensorArray, target: int, points: Floats, shadowing: PathShadowing | None = None
    ) -> None:
        model, positions = sensors.model, sensors.positions
        steps, nodes = sensors.grid.within_each(planar(points), model.reach)
        if isinstance(model, Detects):
            detected = _detected(model, points, positions, steps, nodes)
            steps, nodes = steps[detected], nodes[detected]
        noise = reading_noise(derive(sensors.key, target), steps, nodes, len(components_of(model)))
        readings = model.measure(points[steps], positions[nodes], sensors.traits[nodes], noise)
        if shadowing is not None:
            readings = readings + shadowing.at(steps, nodes)
        ids: list[int] = nodes.tolist()
        values = as_readings(readings)
        self.ids = [ids[a:b] for a, b in _slices(steps, len(points))]
        self._values = [values[a:b] for a, b in _slices(steps, len(points))]

    def readings(self, step: int) -> dict[int, Reading]:
        """{node: reading} of the nodes that measure the target at a step, ascending, whether they are up or not."""
        return dict(zip(self.ids[step], self._values[step], strict=True))

    def appeared(self, step: int) -> list[int]:
        """Nodes that measure the target at this step but did not at the previous one, ascending."""
        return _without(self._ids_at(step), self._ids_at(step - 1) if step else [])

    def vanished(self, step: int) -> list[int]:
        """Nodes that measured the target at the previous step but do not at this one, ascending."""
        return _without(self._ids_at(step - 1), self._ids_at(step)) if step else []

    def _ids_at(self, step: int) -> Iterable[int]:
        """The nodes that measure the target at a step, ascending."""
        return self.ids[step]


def _without(ids: Iterable[int], others: Iterable[int]) -> list[int]:
    """Those of the nodes that are not among the others. Mostly they are the same as in the step before."""
    if ids == others:
        return []
    known = set(others)
    return [node for node in ids if node not in known]


def _detected(model: Detects, points: Floats, positions: Floats, steps: Ints, nodes: Ints) -> Bools:
    """(n,) whether the target is detected at each step by each node within sensing range."""
    slices = _slices(steps, len(points))
    each = [model.detects(point[None], positions[nodes[a:b]])[0] for point, (a, b) in zip(points, slices, strict=True)]
    return np.concatenate(each)


def _slices(steps: Ints, count: int) -> Iterator[tuple[int, int]]:
    """The first and the last index, excluded, of each step in an ascending array of steps."""
    cuts: list[int] = np.searchsorted(steps, np.arange(count + 1)).tolist()
    return itertools.pairwise(cuts)
