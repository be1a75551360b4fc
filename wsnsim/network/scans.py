"""The scans of all nodes at each step: detections of targets, misses and clutter, in an order that names no target.

    scans = Scans(setup, available, trajectories, nodes, key)      scans.readings(step) -> {node: (detection, ...)}

To those that sense, wake and pay, a scan is a reading like any other, of the one thing without a number that nodes
sense: `UNNAMED` stands for a target. A scan is a function of (seed, run, step, node): the readings of each target are
those of labelled readings, missed ones left out; number, values and order of false detections come from hashes that no
target enters. Detections are put into the order of their values first, and then into a random one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys, Reading, components_of, near
from wsnsim.base.arrays import means as means_of
from wsnsim.base.detections import CLUTTER, ReportsScans, space_of
from wsnsim.base.initial_conditions import held, measured_points
from wsnsim.base.rng import HEAD_KEY, derive, derive_all, derive_each, uniforms
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Recorder
from wsnsim.network.nodes import Nodes
from wsnsim.network.sensing import Readings, Reports

UNNAMED: Final = -1
"""Stands for a target in what concerns detections: nobody knows whose they are."""
SCANS: Final = HEAD_KEY + 1
"""In a random key, stands for a target: for clutter and the order of detections."""
COUNT, ORDER, VALUES = 0, 1, 2
"""Random keys of (step, node): number of false detections, order, and values."""


class ReadingsOfAll(dict[int, Any]):
    """The scans of the present step, whichever group asks for them."""

    def __missing__(self, group: int) -> Any:
        return self[UNNAMED]


class Scans(Reports):
    """The scans of all nodes, computed step by step. `origins` says what those of the last step are of.

    Args:
        setup: The scenario.
        available: The readings of each target.
        trajectories: (steps + 1, D) states of each target.
        nodes: The nodes.
        key: The random key of sensing.
    """

    def __init__(
        self,
        setup: TrackingSetup,
        available: Sequence[Readings],
        trajectories: Sequence[Floats],
        nodes: Nodes,
        key: int,
    ) -> None:
        super().__init__(self._scanned, {})
        assert isinstance(setup.detection, ReportsScans), "only such a detection makes scans"
        self._detection, self._sensor = setup.detection, setup.sensor
        self._available, self._nodes, self._key = available, nodes, derive(key, SCANS)
        self._points = [
            held(measured_points(motion, setup.sensor, states, setup.dt))
            for motion, states in zip(setup.motions, trajectories, strict=True)
        ]
        space = space_of(setup.sensor, setup.detection.window) or ()
        self._low, self._wide = np.array([low for low, _ in space]), np.array([high - low for low, high in space])
        self._all = np.arange(len(nodes.positions))
        self.scalar = len(components_of(setup.sensor)) == 1
        self.origins: dict[int, tuple[int, ...]] = {}

    def _scanned(self, step: int) -> dict[int, Any]:
        """{node: detections} of the nodes that have some, ascending; `origins` gets what they are of."""
        keys, found = derive_all(derive(self._key, step), self._all), self._of_targets(step)
        for node, values in self._clutter(keys):
            found.setdefault(node, []).extend((value, CLUTTER) for value in values)
        ordered = {node: _shuffled(found[node], int(keys[node])) for node in sorted(found)}
        self.origins = {node: tuple(origin for _, origin in pairs) for node, pairs in ordered.items()}
        return {node: tuple(value for value, _ in pairs) for node, pairs in ordered.items()}

    def _of_targets(self, step: int) -> dict[int, list[tuple[Reading, int]]]:
        """{node: [(detection, target)]}: one of each detected target, or of several that are not resolved."""
        found: dict[int, list[tuple[Reading, int]]] = {}
        for target, readings in enumerate(self._available):
            for node, value in readings.readings(step).items():
                found.setdefault(node, []).append((value, target))
        if any(self._detection.resolution):
            for node, pairs in found.items():
                if len(pairs) > 1:
                    found[node] = self._merged(step, node, pairs)
        return found

    def _merged(self, step: int, node: int, pairs: list[tuple[Reading, int]]) -> list[tuple[Reading, int]]:
        """One detection for targets that the node cannot resolve, the mean of theirs; its origin is the lowest."""
        targets = [target for _, target in pairs]
        exact = self._exact(step, node, targets)
        group = np.arange(len(pairs))
        for i in range(1, len(pairs)):
            apart = near(self._sensor, np.tile(exact[i], (i, 1)).reshape(-1), exact[:i].reshape(-1)).reshape(i, -1)
            close = (np.abs(apart - exact[:i]) < np.array(self._detection.resolution)).all(axis=1)
            for other in np.flatnonzero(close):
                group[group == group[other]] = i
        _, numbers = np.unique(group, return_inverse=True)
        values = means_of(self._sensor, np.array([value for value, _ in pairs]), numbers, int(numbers.max()) + 1)
        firsts = [targets[list(numbers).index(number)] for number in range(int(numbers.max()) + 1)]
        listed: list[Any] = values.tolist()
        return [(tuple(v) if isinstance(v, list) else v, first) for v, first in zip(listed, firsts, strict=True)]

    def _exact(self, step: int, node: int, targets: Sequence[int]) -> Floats:
        """(n, d) the readings without noise of targets at a step."""
        points = np.array([self._points[target][step] for target in targets])
        which = np.full(len(targets), node)
        size = len(components_of(self._sensor))
        noise = np.zeros(len(targets) if size == 1 else (len(targets), size))
        exact = self._sensor.measure(points, self._nodes.positions[which], self._nodes.traits[which], noise)
        return exact.reshape(len(targets), size)

    def _clutter(self, keys: Keys) -> list[tuple[int, list[Reading]]]:
        """(node, false detections) of the nodes that have some: a Poisson number each, uniform over the space."""
        if not self._detection.clutter:
            return []
        counts = _poisson(uniforms(keys, COUNT), self._detection.clutter)
        nodes = np.flatnonzero(counts)
        each = derive_each(np.repeat(keys[nodes], counts[nodes]), _numbers(counts[nodes]))
        draws = [uniforms(each, VALUES + i) for i in range(len(self._low))]
        columns = [low + wide * draw for low, wide, draw in zip(self._low, self._wide, draws, strict=True)]
        values: list[Any] = (
            columns[0].tolist() if len(columns) == 1 else list(map(tuple, np.column_stack(columns).tolist()))
        )
        ends = np.cumsum(counts[nodes]).tolist()
        return [
            (node, values[end - n : end])
            for node, end, n in zip(nodes.tolist(), ends, counts[nodes].tolist(), strict=True)
        ]


def _numbers(counts: Ints) -> Keys:
    """0, 1, ... for each of the counts, one after the other."""
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    return (np.arange(starts.size) - starts).astype(np.uint64)


def _poisson(shares: Floats, mean: float) -> Ints:
    """(n,) Poisson numbers: the quantiles of uniform shares (n,)."""
    most = int(mean + 12.0 * math.sqrt(mean) + 20.0)
    logs = np.arange(most + 1) * math.log(mean) - mean - np.array([math.lgamma(k + 1.0) for k in range(most + 1)])
    numbers: Ints = np.searchsorted(np.cumsum(np.exp(logs)), shares, side="right")
    return np.minimum(numbers, most)


def _shuffled(pairs: list[tuple[Any, int]], key: int) -> list[tuple[Any, int]]:
    """Detections in a random order that depends on the key and on their values alone."""
    if len(pairs) == 1:
        return pairs
    chances = uniforms(derive_all(derive(key, ORDER), np.arange(len(pairs))), 0)
    ordered = sorted(pairs, key=lambda pair: pair[0])
    return [ordered[i] for i in np.argsort(chances)]


def write_detections(recorder: Recorder, key: Mapping[str, Any], scans: Scans, read: Mapping[int, Any]) -> None:
    """Write the detections of those nodes that scanned, if they are wanted; a row for each component.

    Args:
        recorder: Where the rows go.
        key: Replicate, step and time, by column name.
        scans: The scans of this step.
        read: {node: scan} of the nodes that have one.
    """
    if not read or not recorder.wants("detections"):
        return
    origins = scans.origins
    rows = [
        (node, number, component, value, origins[node][number])
        for node in sorted(read)
        for number, detection in enumerate(read[node])
        for component, value in enumerate(detection if isinstance(detection, tuple) else (detection,))
    ]
    names = ("node", "detection", "component", "reading", "origin")
    columns: dict[str, Any] = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
    if scans.scalar:
        columns.pop("component")
    recorder.write("detections", {**key, **columns})
