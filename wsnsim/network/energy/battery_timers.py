"""Alarms of nodes that may run dry: one SimPy event at a time, for the earliest.

alarms.set(time, node)      `look(node)` is called at that time, or later if nothing else rings before
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import simpy

EVERYBODY = -1
"""In the place of a node: each of them is to be looked at."""


class BatteryTimers:
    """When whom is to be looked at. Times in s."""

    def __init__(self, env: simpy.Environment, look: Callable[[int], None]) -> None:
        self._env = env
        self._look = look
        self._heap: list[tuple[float, int]] = []
        self._due: dict[int, float] = {}
        self._rings_at = math.inf

    def __len__(self) -> int:
        return len(self._heap)

    def due(self, node: int) -> float:
        """When a node is to be looked at next; infinite where no alarm is set, or it has rung."""
        time = self._due.get(node, math.inf)
        return time if time > self._env.now else math.inf

    def set(self, time: float, node: int) -> None:
        """Look at a node at a time of the future, the next instant at least."""
        self._due[node] = time = max(time, math.nextafter(self._env.now, math.inf))
        self._ring(time, node)

    def _ring(self, time: float, node: int) -> None:
        heapq.heappush(self._heap, (time, node))
        if time < self._rings_at:
            self._rings_at = time
            alarm = self._env.timeout(max(time - self._env.now, 0.0))
            assert alarm.callbacks is not None
            alarm.callbacks.append(lambda _: self._rung(time))

    def _rung(self, time: float) -> None:
        """Look at whoever is due, and set the next alarm. An alarm that an earlier one replaced is void."""
        if time != self._rings_at:
            return
        self._rings_at = math.inf
        while self._heap and self._heap[0][0] <= self._env.now:
            self._look(heapq.heappop(self._heap)[1])
        if self._heap:
            self._ring(*heapq.heappop(self._heap))
