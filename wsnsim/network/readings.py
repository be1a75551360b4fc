"""Who senses which target when, and what it reads.

    sensed.readings(step) -> {node: reading}      sensed.appeared(step), sensed.vanished(step) -> [node, ...]

`Sensed` is the faithful one: a single k-d tree query for a whole trajectory. `Imperfect` takes each step when it is
asked for it: readings are missed, targets are sensed that are not there, values are distorted, and a node whose clock
is wrong takes its reading at the wrong time.

Several targets are told apart by a signature in their sound: each has a `Sensed` of its own, and a reading is known to
be of its target (our choice: no association).

Readings are a function of (seed, replicate, target, step, node), so they do not depend on who is awake to take them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Bools, Floats, Ints, Keys, planar
from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.ports import Detection, Detects, SensorModel
from wsnsim.base.rng import HEAD_KEY, derive, derive_all, normals, reading_noise, uniforms
from wsnsim.base.setups import NetworkSetup
from wsnsim.network.clocks import Clocks
from wsnsim.network.faults import change_readings
from wsnsim.network.nodes import Nodes

DISTORTION: Final = HEAD_KEY
"""In the place of a target's number, for what distorts a node's readings at every step."""
ALARMS: Final = HEAD_KEY
"""In the place of a node's number, for who raises a false alarm at a step."""
MISSED, FAR, TURNED = 2, 3, 4
"""Uniforms of (target, step, node): is the reading missed, and where the phantom stands. Its normal takes 0 and 1."""


class Readings:
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


@dataclass(slots=True)
class Imperfections:
    """What keeps sensors from being faithful: how they detect, their clocks, and the defects of this instant."""

    detection: Detection
    clocks: Clocks
    dt: float
    defects: dict[int, SensorDefect] = field(default_factory=dict)

    def matter(self) -> bool:
        """Whether anything distorts a reading, as long as no fault does."""
        probe = np.ones(1)
        keys = np.zeros(1, dtype=np.uint64)
        faithful = self.detection.missed == self.detection.false_alarm == 0
        return not faithful or self.clocks.drift or self.detection.distort(probe, keys) is not probe


class Imperfect(Readings):
    """What nodes report of one target, rightly or wrongly. Takes what `Sensed` takes, and the imperfections.

    Each step is taken once, at its first mention; what was taken stands, whatever fails later.
    """

    def __init__(
        self,
        target: int,
        points: Floats,
        positions: Floats,
        traits: Floats,
        sensor: SensorModel,
        tree: KDTree,
        key: int,
        imperfections: Imperfections,
    ) -> None:
        self._points, self._positions, self._traits = points, positions, traits
        self._sensor = sensor
        self._tree = tree
        self._key = derive(key, target)
        self._distortion = derive(key, DISTORTION)
        self._imperfections = imperfections
        self._times = np.arange(len(points)) * imperfections.dt
        self._extent = float(np.hypot(*np.ptp(positions, axis=0)))
        self._taken: dict[int, dict[int, float]] = {}
        self._stuck_at: dict[tuple[int, int], float] = {}
        self._last: dict[int, float] = {}

    def readings(self, step: int) -> dict[int, float]:
        """{node: reading} of every node that would report one at a step, living or dead, ascending."""
        return dict(self._at(step))

    def appeared(self, step: int) -> list[int]:
        """Nodes that would report at this step and not at the one before, ascending."""
        before: Mapping[int, float] = self._at(step - 1) if step else {}
        return [node for node in self._at(step) if node not in before]

    def vanished(self, step: int) -> list[int]:
        """Nodes that would report at the step before and not at this one, ascending."""
        now = self._at(step)
        return [node for node in self._at(step - 1) if node not in now] if step else []

    def _at(self, step: int) -> dict[int, float]:
        if step not in self._taken:
            self._taken.pop(step - 2, None)
            self._taken[step] = self._take(step)
        return self._taken[step]

    def _take(self, step: int) -> dict[int, float]:
        detection, at_step = self._imperfections.detection, derive(self._key, step)
        nodes, points = self._in_range(step)
        alarmed = _chosen(at_step, detection.false_alarm, len(self._positions))
        alarmed = np.setdiff1d(alarmed, nodes) if alarmed.size else alarmed
        if detection.missed:
            caught = uniforms(derive_all(at_step, nodes), MISSED) >= detection.missed
            nodes, points = nodes[caught], points[caught]
        if alarmed.size:
            phantoms = self._phantoms(alarmed, derive_all(at_step, alarmed))
            nodes, points = np.concatenate([nodes, alarmed]), np.concatenate([points, phantoms])
            order = np.argsort(nodes)
            nodes, points = nodes[order], points[order]
        noise = normals(derive_all(at_step, nodes), 0)
        readings = self._sensor.measure(points, self._positions[nodes], self._traits[nodes], noise)
        reported = detection.distort(readings, derive_all(self._distortion, nodes))
        taken = self._with_defects(dict(zip(nodes.tolist(), reported.tolist(), strict=True)))
        self._last.update(taken)
        return taken

    def _in_range(self, step: int) -> tuple[Ints, Floats]:
        """Who has the target in range when its clock shows the step's time, and where the target is for each.

        A clock that is ahead by e reads the target where it was at t_k - e; one that is behind, where it will be: the
        reading still counts for step k. The truth is interpolated linearly, and stands still beyond its ends.
        """
        time, point = float(self._times[step]), self._points[step]
        astray = self._imperfections.clocks.most(time)
        if not astray:
            nodes = np.array(self._near(point, 0.0), dtype=np.int64)
            if isinstance(self._sensor, Detects):
                nodes = nodes[self._sensor.detects(point[None], self._positions[nodes])[0]]
            return nodes, np.repeat(point[None], nodes.size, axis=0)
        nodes = np.array(self._near(point, self._wander(time, astray)), dtype=np.int64)
        points = self._where(time - self._imperfections.clocks.error(nodes, time))
        sensing = self._detects(points, nodes)
        return nodes[sensing], points[sensing]

    def _near(self, point: Floats, more: float) -> list[int]:
        """Nodes within reach of a point, and so many metres more, ascending."""
        found: list[int] = self._tree.query_ball_point(planar(point), self._sensor.reach + more, return_sorted=True)
        return found

    def _wander(self, time: float, astray: float) -> float:
        """How far the target is from where it should be, at most, for a clock that is wrong by no more than that."""
        between = self._times[(self._times > time - astray) & (self._times < time + astray)]
        places = self._where(np.concatenate([[time - astray, time, time + astray], between]))
        return float(np.linalg.norm(places - places[1], axis=1).max())

    def _where(self, times: Floats) -> Floats:
        """(n, P) the target at these times."""
        return np.column_stack([np.interp(times, self._times, column) for column in self._points.T])

    def _detects(self, points: Floats, nodes: Ints) -> Bools:
        """(n,) whether each node gets a reading of a target at its own one of the points."""
        positions = self._positions[nodes]
        if isinstance(self._sensor, Detects):
            detects = self._sensor.detects
            return np.array([detects(points[i, None], positions)[0, i] for i in range(nodes.size)], dtype=np.bool_)
        within: Bools = np.linalg.norm(planar(points) - positions, axis=1) <= self._sensor.reach
        return within

    def _phantoms(self, nodes: Ints, keys: Keys) -> Floats:
        """(n, P) a target for each node that is not there: uniform in its reach, or in the field if that is smaller."""
        reach = min(self._sensor.reach, self._extent)
        positions = self._positions[nodes]
        if self._points.shape[1] == 1:
            half = np.sqrt(np.maximum(reach**2 - positions[:, 1] ** 2, 0.0))
            return positions[:, :1] + (half * (2.0 * uniforms(keys, FAR) - 1.0))[:, None]
        radius, angle = reach * np.sqrt(uniforms(keys, FAR)), 2.0 * np.pi * uniforms(keys, TURNED)
        return positions + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])

    def _with_defects(self, readings: dict[int, float]) -> dict[int, float]:
        defects = self._imperfections.defects
        for number, node in [key for key in self._stuck_at if key[0] not in defects]:
            del self._stuck_at[number, node]
        for number, defect in sorted(defects.items(), key=lambda item: item[1].stuck):
            for node in defect.nodes.intersection(readings):
                if not defect.stuck:
                    readings[node] += defect.offset
                elif defect.value is not None:
                    readings[node] = defect.value
                else:
                    readings[node] = self._stuck_at.setdefault((number, node), self._last.get(node, readings[node]))
        return readings


def make_senses(
    parts: NetworkSetup, truths: Sequence[Floats], fleet: Nodes, clocks: Clocks, key: int
) -> tuple[list[Readings], Imperfections]:
    """What there is to sense of each target: faithfully, unless something in the scenario speaks against it."""
    imperfections = Imperfections(parts.detection, clocks, parts.dt)
    return _senses(parts, truths, fleet, imperfections, key), imperfections


def search_senses(
    parts: NetworkSetup, paths: Sequence[Floats], fleet: Nodes, imperfections: Imperfections, key: int
) -> list[Readings]:
    """What there is to sense of each target at the instants at which nodes look for it, `parts.polls` a step."""
    between = Imperfections(parts.detection, imperfections.clocks, parts.dt / parts.polls, imperfections.defects)
    return _senses(parts, paths, fleet, between, key)


def _senses(
    parts: NetworkSetup, truths: Sequence[Floats], fleet: Nodes, imperfections: Imperfections, key: int
) -> list[Readings]:
    faithful = not imperfections.matter() and not change_readings(parts.faults)
    senses: list[Readings] = []
    for target, (truth, motion) in enumerate(zip(truths, parts.motions, strict=True)):
        points = truth[:, list(motion.position)]
        what = target, points, fleet.positions, fleet.traits, parts.sensor, fleet.tree, key
        senses.append(Readings(*what) if faithful else Imperfect(*what, imperfections))
    return senses


def _chosen(key: int, probability: float, size: int) -> Ints:
    """Which of `size` nodes an event befalls, each with this probability: the gaps between them are geometric.

    Costs as much as there are such nodes, not as much as there are nodes.
    """
    if probability <= 0.0:
        return np.empty(0, dtype=np.int64)
    if probability >= 1.0:
        return np.arange(size)
    alarms, expected = derive(key, ALARMS), size * probability
    batch, last = int(expected + 6.0 * expected**0.5 + 8.0), -1
    found: list[Ints] = []
    while last < size:
        drawn = uniforms(derive_all(alarms, np.arange(batch) + batch * len(found)), 0)
        gaps = np.minimum(np.log1p(-drawn) / np.log1p(-probability), size).astype(np.int64)
        ids = last + np.cumsum(gaps + 1)
        found.append(ids[ids < size])
        last = int(ids[-1])
    return np.concatenate(found)


def _detecting(sensor: Detects, point: Floats, ids: list[int], positions: Floats) -> list[int]:
    """Those of the nodes within reach whose sensor says that it gets a reading."""
    heard = sensor.detects(point[None], positions[ids])[0]
    return [node for node, yes in zip(ids, heard.tolist(), strict=True) if yes]
