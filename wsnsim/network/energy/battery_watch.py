"""When nodes that consume energy over time are to be checked, because their batteries may run out."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from typing import Final

import simpy

from wsnsim.base.radio import Mode
from wsnsim.network.energy.power_table import ASLEEP, AWAKE, MODES, PowerTable
from wsnsim.network.energy.storage import BatteryRates
from wsnsim.network.event_log import then
from wsnsim.network.node_states import SleepStates

NEAR: Final = 1e-2
"""If the predicted lifetime (s) is below this, check at the predicted depletion time; otherwise after half of it."""
SOON: Final = 1e-9
"""A charge that lasts for less than this time (s) is what rounding leaves: the battery is empty."""
SHORTEST: Final = 5e-3
"""Mean time (s) between changes of the fastest schedule: two in its period of 10 ms."""
EVERYBODY = -1
"""Stands for a node: every node is to be checked."""
LOAD_ALONE: Final = BatteryRates()
"""A battery that nothing but the load changes."""


class BatteryTimers:
    """The times at which nodes are to be checked, in s. One SimPy event at a time, for the earliest.

    timers.set(time, node)      calls `check(node)` at that time
    """

    def __init__(self, env: simpy.Environment, check: Callable[[int], None]) -> None:
        self._env = env
        self._check = check
        self._heap: list[tuple[float, int]] = []
        self._due: dict[int, float] = {}
        self._fires_at = math.inf

    def __len__(self) -> int:
        return len(self._heap)

    def due(self, node: int) -> float:
        """The time of the next check of a node, infinite if none is set."""
        time = self._due.get(node, math.inf)
        return time if time > self._env.now else math.inf

    def set(self, time: float, node: int) -> None:
        """Check a node at a time, at the earliest one instant from now."""
        self._due[node] = time = max(time, math.nextafter(self._env.now, math.inf))
        self._schedule(time, node)

    def _schedule(self, time: float, node: int) -> None:
        heapq.heappush(self._heap, (time, node))
        if time < self._fires_at:
            self._fires_at = time
            then(self._env.timeout(max(time - self._env.now, 0.0)), self._fired, time)

    def _fired(self, time: float) -> None:
        """Check the nodes that are due, and schedule the next event. An event that an earlier one replaced is void."""
        if time != self._fires_at:
            return
        self._fires_at = math.inf
        while self._heap and self._heap[0][0] <= self._env.now:
            self._check(heapq.heappop(self._heap)[1])
        if self._heap:
            self._schedule(*heapq.heappop(self._heap))


class BatteryWatch:
    """The battery timers of nodes that consume by a power table. A node is given with its state.

    Attributes:
        most: Joules that one node can consume at most in the whole run.
        timers: The battery timers.
    """

    def __init__(
        self, env: simpy.Environment, table: PowerTable, sleep_states: SleepStates, per_switch: float, horizon: float,
        battery: float, check: Callable[[int], None],
    ) -> None:  # fmt: skip
        """Find the limits, and begin to watch.

        Args:
            env: The clock.
            table: The power of a node in each state.
            sleep_states: Which nodes are awake.
            per_switch: Mean joules of a change between awake and asleep.
            horizon: End of the run in s.
            battery: J that every node has at the start; 0: all are looked at when the run begins.
            check: Called with a node that may have run out, or with EVERYBODY.
        """
        self._env = env
        self._table = table
        self._sleep_states = sleep_states
        self._horizon = horizon
        self.most = table.largest() * horizon
        awake = [level * MODES + AWAKE for level in range(len(table.radio) // MODES)]
        self._most_by_schedule = max(map(table.total, (*awake, ASLEEP))) + per_switch / SHORTEST
        self._changes = 4.0 * per_switch  # half of it pays two changes that come at once, however slow
        if per_switch:
            self.most += sleep_states.most_switches(horizon) * per_switch
        self.timers = BatteryTimers(env, check)
        rest = sleep_states.rest
        resting = 2.0 * self._most_by_schedule if rest is Mode.SCHEDULED else table.total(int(rest))
        if (resting > 0 or not battery) and battery <= self.most:
            self.timers.set(battery / resting if battery > self._changes else 0.0, EVERYBODY)

    def watch(self, node: int, state: int, left: float, supply: BatteryRates) -> None:
        """Set a timer for a node with `left` joules, if it may run out before the end."""
        if left > self.most + supply.leak * self._horizon:
            return
        power, now = self._power(node, state) + supply.leak, self._env.now
        if self._table.scheduled[state]:
            self._watch_schedule(node, power - supply.stored, left, supply)
            return
        if power <= 0 or now + left / power > self._horizon:
            return
        net = power - supply.stored
        lasts = left / net if net > 0 else math.inf
        due = now + (lasts if lasts < NEAR else lasts / 2)
        if self.timers.due(node) > min(now + lasts, supply.until):
            self.timers.set(min(due, supply.until), node)

    def _watch_schedule(self, node: int, power: float, left: float, supply: BatteryRates) -> None:
        """Check again when its schedule or its supply changes, or earlier if the charge may not last until then."""
        now, most = self._env.now, self._most_by_schedule + supply.leak
        due = min(self._sleep_states.next_change(node), supply.until)
        lasts = left / power if power > 0 else math.inf
        if now + lasts < due:
            due = now + (lasts if lasts < NEAR else lasts / 2)
        elif most > 0 and left > self._changes:
            due = max(due, now + left / most / 2)
        if due <= self._horizon and self.timers.due(node) > due:
            self.timers.set(due, node)

    def runs_out(self, node: int, state: int, left: float, supply: BatteryRates) -> bool:
        """Whether `left` joules of a node are only what rounding leaves."""
        return left <= (self._power(node, state) + supply.leak) * SOON

    def _power(self, node: int, state: int) -> float:
        """Power in W of a node now."""
        if self._table.scheduled[state]:
            awake = self._sleep_states.scheduled(node) is Mode.AWAKE
            state = state - state % MODES + AWAKE if awake else ASLEEP
        return self._table.total(state)
