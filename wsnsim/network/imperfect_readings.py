"""The readings of imperfect sensors, in a network or without: errors of detection or of value, or wrong clocks.

Each step is computed when it is first asked for: readings are missed, false alarms are raised, values are distorted,
and a node whose clock is wrong takes its reading at the wrong time. Without any of these the readings are, to the
last bit, those of `Readings`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints, Keys, Reading, as_readings, components_of, planar
from wsnsim.base.initial_conditions import InitialConditions, held, measured_points, node_names
from wsnsim.base.mechanisms import SensorDefect, StartsFault
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.optional_ports import Detects
from wsnsim.base.ports import Detection
from wsnsim.base.rng import HEAD_KEY, Streams, component_noise, derive, derive_all, derive_each, uniforms
from wsnsim.base.sensing import PathShadowing, is_perfect, path_shadowing
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Memory
from wsnsim.models.hardware import PerfectClock
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.faults import FaultSchedule, FaultSite
from wsnsim.network.nodes import Nodes
from wsnsim.network.sensing import Readings, Reports, SensorArray

CHANGE_READINGS: Final = frozenset({"clock_step", "stuck", "bias"})
"""Built-in mechanisms that change what sensors read."""
DISTORTION: Final = HEAD_KEY
"""In a random key, stands for a target: for what distorts a node's readings at every step."""
ALARMS: Final = HEAD_KEY
"""In a random key, stands for a node: for which nodes raise a false alarm at a step."""


MISSED, DISTANCE, ANGLE = 2, 3, 4
"""Uniform numbers of (target, step, node): is the reading missed, and where the false target is. Noise uses 0 and 1."""


@dataclass(slots=True)
class Imperfections:
    """What makes readings wrong: detection, clocks, and the sensor defects of this instant, by fault number.

    `key` is that of the stream `sense`, on which shadowing depends at steps and between them.
    """

    detection: Detection
    clocks: Clocks
    dt: float
    key: int = 0
    defects: dict[int, SensorDefect] = field(default_factory=dict)

    def matter(self) -> bool:
        """Whether any reading is wrong while no fault is active."""
        return not is_perfect(self.detection) or not self.clocks.perfect


class ImperfectSensors:
    """What the sensors of all nodes measure of one target, before any of them fails: `take` gives it at a step.

    Args:
        sensors: The sensors of all nodes.
        target: Number of the target.
        points: (steps, P) its positions; NaN where it is absent.
        imperfections: What makes readings wrong.
        shadowing: What shadowing adds to the readings, at the step's time whatever a clock shows; None: nothing.
    """

    def __init__(
        self,
        sensors: SensorArray,
        target: int,
        points: Floats,
        imperfections: Imperfections,
        shadowing: PathShadowing | None = None,
    ) -> None:
        self._shadowing = shadowing
        self._points, self._present = held(points), np.isfinite(points[:, 0])
        self._positions, self._traits = sensors.positions, sensors.traits
        self._sensor = sensors.model
        self._grid = sensors.grid
        self._key = derive(sensors.key, target)
        self._distortion = derive(sensors.key, DISTORTION)
        self._imperfections = imperfections
        self._times = np.arange(len(points)) * imperfections.dt
        self._extent = float(np.hypot(*np.ptp(sensors.positions, axis=0)))

    def take(self, step: int) -> dict[int, Reading]:
        """{node: reading} as measured at a step, ascending, false alarms included."""
        detection, at_step = self._imperfections.detection, derive(self._key, step)
        nodes, points = self._in_range(step)
        alarmed = _sampled(at_step, detection.false_alarm, len(self._positions))
        alarmed = np.setdiff1d(alarmed, nodes) if alarmed.size else alarmed
        if detection.missed:
            caught = uniforms(derive_all(at_step, nodes), MISSED) >= detection.missed
            nodes, points = nodes[caught], points[caught]
        if alarmed.size:
            points_of_alarms = self._false_targets(alarmed, derive_all(at_step, alarmed))
            points_of_alarms = np.column_stack([points_of_alarms, self._heights(step, len(alarmed))])
            nodes, points = np.concatenate([nodes, alarmed]), np.concatenate([points, points_of_alarms])
            order = np.argsort(nodes)
            nodes, points = nodes[order], points[order]
        noise = component_noise(derive_all(at_step, nodes), len(components_of(self._sensor)))
        readings = self._sensor.measure(points, self._positions[nodes], self._traits[nodes], noise)
        if self._shadowing is not None:
            readings = readings + self._shadowing.at(np.full(nodes.size, step), nodes)
        reported = distorted(detection, readings, derive_all(self._distortion, nodes))
        return dict(zip(nodes.tolist(), as_readings(reported), strict=True))

    def _in_range(self, step: int) -> tuple[Ints, Floats]:
        """Nodes with the target in range when their clocks show the time of the step, and where it is for each of them.

        A node whose clock is ahead by e measures the target where it was at t_k - e; its reading counts for step k. The
        trajectory is interpolated linearly, and constant beyond its ends.
        """
        if not self._present[step]:
            return np.empty(0, dtype=np.int64), self._points[:0]
        time, point = float(self._times[step]), self._points[step]
        error = self._imperfections.clocks.largest_error(time)
        if not error:
            nodes = self._near(point, 0.0)
            if isinstance(self._sensor, Detects):
                nodes = nodes[self._sensor.detects(point[None], self._positions[nodes])[0]]
            return nodes, np.repeat(point[None], nodes.size, axis=0)
        nodes = self._near(point, self._displacement(time, error))
        points = self._at_times(time - self._imperfections.clocks.error(nodes, time))
        sensing = self._detects(points, nodes)
        return nodes[sensing], points[sensing]

    def _near(self, point: Floats, margin: float) -> Ints:
        """Nodes within sensing range plus a margin in m of a point, ascending."""
        return self._grid.within(planar(point), self._sensor.reach + margin)

    def _displacement(self, time: float, error: float) -> float:
        """Largest distance in m of the target from its position at a time, at times that differ by at most `error`."""
        between = self._times[(self._times > time - error) & (self._times < time + error)]
        points = self._at_times(np.concatenate([[time - error, time, time + error], between]))
        return float(np.linalg.norm(points - points[1], axis=1).max())

    def _at_times(self, times: Floats) -> Floats:
        """(n, P) positions of the target at times (n,)."""
        return np.column_stack([np.interp(times, self._times, column) for column in self._points.T])

    def _detects(self, points: Floats, nodes: Ints) -> Bools:
        """(n,) whether each node detects a target at its own point."""
        positions = self._positions[nodes]
        if isinstance(self._sensor, Detects):
            detects = self._sensor.detects
            return np.array([detects(points[i, None], positions)[0, i] for i in range(nodes.size)], dtype=np.bool_)
        within: Bools = np.linalg.norm(planar(points) - positions, axis=1) <= self._sensor.reach
        return within

    def _false_targets(self, nodes: Ints, keys: Keys) -> Floats:
        """(n, P) the target of each node's false alarm: uniform in its sensing range, or the field if smaller."""
        reach = min(self._sensor.reach, self._extent)
        positions = self._positions[nodes]
        if self._points.shape[1] == 1:
            half = np.sqrt(np.maximum(reach**2 - positions[:, 1] ** 2, 0.0))
            on_axis: Floats = positions[:, :1] + (half * (2.0 * uniforms(keys, DISTANCE) - 1.0))[:, None]
            return on_axis
        radius, angle = reach * np.sqrt(uniforms(keys, DISTANCE)), 2.0 * np.pi * uniforms(keys, ANGLE)
        in_plane: Floats = positions + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        return in_plane

    def _heights(self, step: int, count: int) -> Floats:
        """(count, 1) the target's height at a step, or (count, 0) where points have none."""
        return np.repeat(self._points[step : step + 1, 2:], count, axis=0)


def distorted(detection: Detection, readings: Floats, keys: Keys) -> Floats:
    """The reported readings, given one counter key per node, which is the same at every step.

    Each component of readings (n, M) is distorted by itself: the first with the key of its node, further ones with keys
    derived from it (our choice), so that errors of calibration are independent.
    """
    if readings.ndim == 1:
        return detection.distort(readings, keys)
    numbers = range(readings.shape[1])
    each = [keys if number == 0 else derive_each(keys, np.array([number], dtype=np.uint64)) for number in numbers]
    return np.stack([detection.distort(readings[:, m].copy(), each[m]) for m in numbers], axis=1)


def _change_readings(faults: Iterable[FaultEvent]) -> bool:
    """Whether any of the faults may change what sensors read. A plug-in may."""
    return any(fault.mechanism in CHANGE_READINGS or isinstance(fault, StartsFault) for fault in faults)


def make_readings(
    setup: TrackingSetup, trajectories: Sequence[Floats], nodes: Nodes, imperfections: Imperfections, key: int
) -> list[Readings]:
    """Return the readings of each target every `imperfections.dt` s, with noise of a key."""
    if setup.recorded is not None:
        steps, names = len(trajectories[0]) - 1, node_names(setup, len(nodes.positions))
        recordings = setup.recorded.recordings(names, len(setup.motions), steps, imperfections.dt)
        return [Reports(partial(_recorded_at, each.readings), imperfections.defects) for each in recordings]
    sensors = SensorArray(nodes.positions, nodes.traits, setup.sensor, nodes.grid, key)
    perfect, dt = not imperfections.matter() and not _change_readings(setup.faults), imperfections.dt
    result: list[Readings] = []
    for target, (trajectory, motion) in enumerate(zip(trajectories, setup.motions, strict=True)):
        points = measured_points(motion, setup.sensor, trajectory, dt)
        instants, sense = round(setup.dt / dt), derive(imperfections.key, target)
        shadowing = path_shadowing(setup.sensor, held(points), sense, instants)
        if perfect:
            result.append(Readings(sensors, target, points, shadowing))
        else:
            take = ImperfectSensors(sensors, target, points, imperfections, shadowing).take
            result.append(Reports(take, imperfections.defects, components_of(setup.sensor)))
    return result


def _recorded_at(recorded: Floats, step: int) -> dict[int, Reading]:
    """{node: reading} of the nodes that have one at a step of a recording (steps, N), wherever the target is.

    Wrong clocks do not change it: the recording gives the times.
    """
    nodes = np.flatnonzero(np.isfinite(recorded[step]))
    return dict(zip(nodes.tolist(), recorded[step][nodes].tolist(), strict=True))


def _sampled(key: int, probability: float, size: int) -> Ints:
    """Sample each of `size` nodes with a probability. The gaps between sampled nodes are geometric.

    The cost grows with the number of sampled nodes, not with `size`.
    """
    if probability <= 0.0:
        return np.empty(0, dtype=np.int64)
    if probability >= 1.0:
        return np.arange(size)
    alarms, expected = derive(key, ALARMS), size * probability
    batch, last = int(expected + 6.0 * expected**0.5 + 8.0), -1
    found: list[Ints] = []
    while last < size:
        samples = uniforms(derive_all(alarms, np.arange(batch) + batch * len(found)), 0)
        gaps = np.minimum(np.log1p(-samples) / np.log1p(-probability), size).astype(np.int64)
        ids = last + np.cumsum(gaps + 1)
        found.append(ids[ids < size])
        last = int(ids[-1])
    return np.concatenate(found)


class StandaloneReports:
    """The reports on one target of a run, in the order of steps.

        rows = StandaloneReports(setup, conditions, streams, target)      rows(first, count) -> (count, S) readings

    Sensors are all that there is: a fault may change their readings, or stop them while their node is down. Nothing
    else of a node fails: messages reach it, and it keeps what it knows (our choice).
    """

    def __init__(self, setup: TrackingSetup, conditions: InitialConditions, streams: Streams, target: int) -> None:
        self._dt, self._last = setup.dt, setup.steps
        self._env = env = simpy.Environment()
        self._nodes = nodes = Nodes(conditions.positions, conditions.traits, math.inf, setup.sensor.reach)
        clocks = Clocks(PerfectClock(), 0, nodes.size, env)
        imperfections = Imperfections(setup.detection, clocks, setup.dt, key := streams.key("sense"))
        self._available = make_readings(setup, conditions.truths, nodes, imperfections, key)[target]
        log, actions = EventLog(Memory({}), 0), (nodes.crash, lambda node: nodes.restart(node, env.now), lambda _: None)
        site = FaultSite(env, nodes, log, clocks, *actions, imperfections.defects)
        FaultSchedule(setup.faults, site, streams.key("faults"), setup.dt).start()
        count = len(components_of(setup.sensor))
        self._shape = (nodes.size,) if count == 1 else (nodes.size, count)

    def __call__(self, first: int, count: int) -> Floats:
        """(count, S) or (count, S, M) the reports of the steps from `first` on; NaN where a sensor has none.

        They end with the run. Steps may be left out, but not asked for again.
        """
        reports = np.full((max(0, min(count, self._last + 1 - first)), *self._shape), np.nan)
        for row, step in enumerate(range(first, first + len(reports))):
            while self._env.peek() <= step * self._dt:
                self._env.step()
            for node, reading in self._available.readings(step).items():
                if self._nodes.living[node]:
                    reports[row, node] = reading
        return reports
