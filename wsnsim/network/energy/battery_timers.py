"""Battery timers: when to check nodes whose batteries may run out. One SimPy event at a time, for the earliest.

timers.set(time, node)      calls `check(node)` at that time
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import simpy

EVERYBODY = -1
"""Stands for a node: every node is to be checked."""


class BatteryTimers:
    """The times at which nodes are to be checked, in s."""

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
            timer = self._env.timeout(max(time - self._env.now, 0.0))
            assert timer.callbacks is not None
            timer.callbacks.append(lambda _: self._fired(time))

    def _fired(self, time: float) -> None:
        """Check the nodes that are due, and schedule the next event. An event that an earlier one replaced is void."""
        if time != self._fires_at:
            return
        self._fires_at = math.inf
        while self._heap and self._heap[0][0] <= self._env.now:
            self._check(heapq.heappop(self._heap)[1])
        if self._heap:
            self._schedule(*heapq.heappop(self._heap))
