"""The processors of the nodes: what a computation costs, how long it takes, and how many operations were computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from wsnsim.base.radio import Cpu, EnergyModel
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.step_clock import StepClock

COMPUTE: Final = KIND["compute"]
CPU_CAUSE: Final = CAUSE["cpu"]
CPU_EVENT_CAUSE: Final = EVENT_CAUSE["cpu"]


class Processors:
    """Books computations. `operations` is the number computed so far in the whole network."""

    def __init__(self, clock: StepClock, nodes: Nodes, event_log: EventLog, energy: EnergyModel, cpu: Cpu) -> None:
        self._clock = clock
        self._nodes = nodes
        self._event_log = event_log
        self._energy = energy
        self._cpu = cpu
        self.operations = 0.0

    def compute_all(self, nodes: list[int], operations: Sequence[float], target: int) -> float:
        """Book a computation at each of several nodes; return the simulated seconds of the longest, 0 for none."""
        cycles = {each: each * self._cpu.cycles_per_flop for each in set(operations)}
        joules = {each: self._energy.compute(count) for each, count in cycles.items()}
        spent = [joules[each] for each in operations]
        if not nodes or min(spent) <= 0 or not self._nodes.all_outlast(nodes, sum(spent)):
            seconds = [self.compute(node, each, target) for node, each in zip(nodes, operations, strict=True)]
            return max(seconds, default=0.0)
        for count in operations:
            self.operations += count
        self._nodes.consumption.mark_all_computing(nodes, [cycles[each] for each in operations])
        self._nodes.ledger.book_cause(nodes, CPU_CAUSE, spent)
        now, step = self._clock.env.now, self._clock.step
        self._event_log.extend(
            [(now, step, target, node, COMPUTE, 0, 0, 0, -1, 0, 0, each, CPU_EVENT_CAUSE)
             for node, each in zip(nodes, spent, strict=True)]
        )  # fmt: skip
        return max([self._cpu.seconds(count) for count in cycles.values()])

    def compute(self, node: int, operations: float, target: int) -> float:
        """Book a computation and return the simulated seconds that it takes; free computations are not logged."""
        self.operations += operations
        cycles = operations * self._cpu.cycles_per_flop
        joules = self._energy.compute(cycles)
        self._nodes.consumption.mark_computing(node, cycles)
        if joules > 0:
            spent = self._nodes.spend(node, CPU_CAUSE, joules)
            clock = self._clock
            self._event_log.add(
                event(clock.env.now, clock.step, target, node, COMPUTE, 0, 0, 0, -1, 0, 0, spent, CPU_EVENT_CAUSE)
            )
        return self._cpu.seconds(cycles)
