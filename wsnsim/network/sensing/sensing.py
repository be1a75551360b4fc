"""Who senses each target at the present step, and what that costs and wakes.

sensing.update(target)      sensing.readings[target] -> {node: reading} of the living nodes that sense it now
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.base.vector_readings import Reading
from wsnsim.network.event_log import EACH, EventLog, event
from wsnsim.network.node import NodeProcesses
from wsnsim.network.nodes import Nodes
from wsnsim.network.sensing.readings import Readings
from wsnsim.network.step_clock import StepClock

SENSE: Final = KIND["sense"]
SENSE_CAUSE: Final = CAUSE["sense"]
CurrentReadings = list[dict[int, Reading]]
"""By target: {node: reading} of the living nodes that sense it at the present step."""


@dataclass(frozen=True, slots=True)
class SensingServices:
    """What sensing uses. `available[target]` gives every node's reading; `joules` is the cost of taking one."""

    clock: StepClock
    nodes: Nodes
    processes: NodeProcesses
    event_log: EventLog
    available: Sequence[Readings]
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
        for readings in self.readings:
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
        for target, available in enumerate(services.available):
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
