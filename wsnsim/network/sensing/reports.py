"""What nodes report at each step: the readings that they take, with the defects of their sensors.

Reports(take, defects).at(step) -> {node: reading}
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.vector_readings import SCALAR, Reading


class Reports:
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
