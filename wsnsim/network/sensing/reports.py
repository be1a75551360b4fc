"""What nodes report at each step: the readings that they take, with the defects of their sensors.

Reports(take, defects).at(step) -> {node: reading}
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from wsnsim.base.mechanisms import SensorDefect


class Reports:
    """The readings of one target as nodes report them. What was read at a step stays, whatever fails later.

    Args:
        take: step -> {node: reading} as measured.
        defects: the sensor defects of this instant, by fault number.
    """

    def __init__(self, take: Callable[[int], dict[int, float]], defects: Mapping[int, SensorDefect]) -> None:
        self._take, self._defects = take, defects
        self._taken: dict[int, dict[int, float]] = {}
        self._stuck_at: dict[tuple[int, int], float] = {}
        self._last: dict[int, float] = {}

    def at(self, step: int) -> dict[int, float]:
        """{node: reading} of a step, which may be asked for again at the next one; not to be changed."""
        if step not in self._taken:
            self._taken.pop(step - 2, None)
            self._taken[step] = self._with_defects(self._take(step))
            self._last.update(self._taken[step])
        return self._taken[step]

    def _with_defects(self, readings: dict[int, float]) -> dict[int, float]:
        """Readings with the defects of this instant: offsets first, since a sensor that is stuck ignores them."""
        defects = self._defects
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
