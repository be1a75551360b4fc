"""Sensing: the readings that sensors would take, their faults, who takes them at each step, and what that costs.

sensing.update(target)      sensing.readings[target] -> {node: reading} of the living nodes that sense it now
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import SCALAR, Bools, Floats, Ints, Reading, as_readings, components_of, planar
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.optional_ports import Detects
from wsnsim.base.ports import SensorModel
from wsnsim.base.rng import derive, reading_noise
from wsnsim.base.sensing import PathShadowing
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import EACH, EventLog, StepClock, event
from wsnsim.network.node_process import NodeProcesses
from wsnsim.network.nodes import Nodes

SENSE: Final = KIND["sense"]
SENSE_CAUSE: Final = CAUSE["sense"]


class SensorArray(NamedTuple):
    """The sensors of all nodes: positions (N, 2), traits such as gains (N, T), sensor model, and key of the noise."""

    positions: Floats
    traits: Floats
    model: SensorModel
    grid: CellGrid
    key: int


class Readings:
    """The readings of one target, computed for the whole trajectory at once. Steps run from 0 to `len(points) - 1`.

        readings.readings(step) -> {node: reading}      readings.appeared(step), readings.vanished(step) -> [node, ...]

    It is known which target each reading belongs to (our choice: no data association). A reading is a function of
    (seed, run, target, step, node), so it does not depend on which nodes are awake to take it.

    Args:
        sensors: The sensors of all nodes.
        target: Number of the target.
        points: Its positions (steps, P); NaN where it is absent: it is not measured then.
        shadowing: What shadowing adds to the readings; None: nothing.
    """

    def __init__(
        self, sensors: SensorArray, target: int, points: Floats, shadowing: PathShadowing | None = None
    ) -> None:
        model, positions = sensors.model, sensors.positions
        present = np.flatnonzero(np.isfinite(points[:, 0]))
        steps, nodes = sensors.grid.within_each(planar(points[present]), model.reach)
        steps = present[steps]
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


class Reports(Readings):
    """The readings of one target as nodes report them. What was read at a step stays, whatever fails later.

    Args:
        take: step -> {node: reading} as measured.
        defects: the sensor defects of this instant, by fault number.
        components: names of the components of a reading.
    """

    def __init__(
        self,
        take: Callable[[int], dict[int, Reading]],
        defects: Mapping[int, SensorDefect],
        components: tuple[str, ...] = SCALAR,
    ) -> None:
        self._take, self._defects, self._components = take, defects, components
        self._taken: dict[int, dict[int, Reading]] = {}
        self._stuck_at: dict[tuple[int, int], Reading] = {}
        self._last: dict[int, Reading] = {}

    def at(self, step: int) -> dict[int, Reading]:
        """{node: reading} of a step, which may be asked for again at the next one; not to be changed."""
        if step not in self._taken:
            self._taken.pop(step - 2, None)
            self._taken[step] = self._with_defects(self._take(step))
            self._last.update(self._taken[step])
        return self._taken[step]

    def readings(self, step: int) -> dict[int, Reading]:
        """{node: reading} of the nodes that report one at a step, ascending, whether they are up or not."""
        return dict(self.at(step))

    def _ids_at(self, step: int) -> Iterable[int]:
        return self.at(step)

    def _with_defects(self, readings: dict[int, Reading]) -> dict[int, Reading]:
        """Readings with the defects of this instant: offsets first, since a sensor that is stuck ignores them."""
        defects = self._defects
        for number, node in [key for key in self._stuck_at if key[0] not in defects]:
            del self._stuck_at[number, node]
        for number, defect in sorted(defects.items(), key=lambda item: item[1].stuck):
            for node in defect.nodes.intersection(readings):
                readings[node] = self._defective(number, defect, node, readings[node])
        return readings

    def _defective(self, number: int, defect: SensorDefect, node: int, reading: Reading) -> Reading:
        """The reading of a node that has a defect of this fault number."""
        before = _numbers(reading)
        if not defect.stuck:
            after = tuple([value + defect.offset for value in before])
        elif defect.value is not None:
            after = (defect.value,) * len(before)
        else:
            after = _numbers(self._stuck_at.setdefault((number, node), self._last.get(node, reading)))
        concerned = [defect.component in ("", name) for name in self._components]
        mixed = tuple([new if hit else old for hit, old, new in zip(concerned, before, after, strict=True)])
        return mixed if isinstance(reading, tuple) else mixed[0]


def _numbers(reading: Reading) -> tuple[float, ...]:
    """The components of a reading."""
    return reading if isinstance(reading, tuple) else (reading,)


CurrentReadings = dict[int, dict[int, Reading]]
"""By target: {node: reading} of the living nodes that sense it at the present step."""


class SensingServices(NamedTuple):
    """What sensing uses. `available[target]` gives every node's reading; `joules` is the cost of taking one."""

    clock: StepClock
    nodes: Nodes
    processes: NodeProcesses
    event_log: EventLog
    available: Mapping[int, Readings]
    joules: float


class Sensing(ABC):
    """How nodes sense. `readings` is changed by `update` and `remove` alone."""

    def __init__(self, services: SensingServices, readings: CurrentReadings) -> None:
        self.readings = readings
        self._services = services

    @abstractmethod
    def update(self, target: int) -> None:
        """Take the readings of the present step."""

    def remove(self, node: int) -> None:
        """Discard the readings of a node that is no longer up."""
        for readings in self.readings.values():
            readings.pop(node, None)

    def restart(self, node: int) -> None:  # noqa: B027 (event-driven sensing alone does something here)
        """Note that a node that was down is up again: its schedule says when it senses."""

    def _pay(self, target: int, readings: dict[int, Reading]) -> dict[int, Reading]:
        """Book and log a reading of every living node; return the readings of those that survived the cost."""
        services, alive = self._services, self._services.nodes.alive
        if not services.nodes.all_listen:
            readings = {index: value for index, value in readings.items() if alive[index]}
        now, step = services.clock.now, services.clock.step
        if not services.joules:
            if readings:
                ids = np.fromiter(readings, np.int64, len(readings))
                services.event_log.add_all(event(now, step, target, EACH, SENSE), ids)
            return readings
        paid = {index: services.nodes.spend(index, SENSE_CAUSE, services.joules) for index in readings}
        services.event_log.extend(
            [event(now, step, target, index, SENSE, joules=spent, cause=EVENT_CAUSE["sense"])
             for index, spent in paid.items() if spent]
        )  # fmt: skip
        return {index: value for index, value in readings.items() if alive[index]}

    def _awake(self, target: int) -> dict[int, Reading]:
        """The readings of the nodes that are awake."""
        services = self._services
        readings = services.available[target].readings(services.clock.step)
        return {index: value for index, value in readings.items() if services.nodes.is_awake(index)}


class EventDrivenSensing(Sensing):
    """Every living node senses; a node wakes when a target comes into range and rests when it leaves."""

    def update(self, target: int) -> None:
        """Take the readings of the present step."""
        services = self._services
        available, step, alive = services.available[target], services.clock.step, services.nodes.alive
        for index in available.vanished(step):
            if alive[index]:
                services.processes.of(index).lose_target(target)
        for index in available.appeared(step):
            if alive[index]:
                services.processes.of(index).hear_target(target)
        self.readings[target] = self._pay(target, available.readings(step))

    def restart(self, node: int) -> None:
        """Wake a node that was down, if a target is in range."""
        services = self._services
        for target, available in services.available.items():
            if node in available.readings(services.clock.step):
                services.processes.of(node).hear_target(target)


class ScheduledSensing(Sensing):
    """Nodes that are awake sense; a node that senses a target stays awake while it does."""

    def update(self, target: int) -> None:
        """Take the readings of the present step."""
        processes, before = self._services.processes, self.readings[target]
        now = self.readings[target] = self._awake(target)
        for index in before:
            if index not in now and self._services.nodes.alive[index]:
                processes.of(index).lose_target(target)
        for index in now:
            if index not in before:
                processes.of(index).hear_target(target)
        self.readings[target] = self._pay(target, now)


class ContinuousSensing(Sensing):
    """Nodes that are awake search for targets all the time, which is part of their background consumption."""

    def update(self, target: int) -> None:
        """Take the readings of the present step."""
        self.readings[target] = self._awake(target)


def make_sensing(services: SensingServices, readings: CurrentReadings, nodes_search: bool) -> Sensing:
    """The way of sensing of a scenario. `nodes_search`: awake nodes search for targets without a track."""
    if nodes_search:
        return ContinuousSensing(services, readings)
    scheduled = services.nodes.follows_schedules
    return ScheduledSensing(services, readings) if scheduled else EventDrivenSensing(services, readings)
