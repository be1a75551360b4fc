"""What a duty-cycled MAC made of radios: which are held on, which duty each follows, what it added to their cost."""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, scalars
from wsnsim.network.energy.duty_cycles import DutyCycles
from wsnsim.network.energy.ledger import Charges
from wsnsim.network.energy.power_table import IDLE, MODES, SWITCH, PowerTable, level_of


class RadioLevels:
    """The radios of all nodes; without a duty-cycled MAC it holds nothing.

    Attributes:
        active: Whether the MAC is duty-cycled.
        added: {cause: (N,) joules that the MAC added to those of the duty since the node was settled; or took off}
    """

    def __init__(self, table: PowerTable, size: int) -> None:
        self.active = bool(table.duties)
        joules = np.zeros((2, size if self.active else 0))
        self.added = {IDLE: joules[0], SWITCH: joules[1]}
        self._listened, self._switched = scalars(joules[0]), scalars(joules[1])
        self._held: dict[int, tuple[float, bool]] = {}
        self._duty_level: dict[int, int] = {}
        self._scheduled: dict[int, int] = {}
        self._awake = [0.0] * (len(table.radio) // MODES)

    def is_held(self, node: int) -> bool:
        """Whether the radio of a node is held on."""
        return node in self._held

    def hold(self, node: int, now: float, on: bool) -> None:
        """A radio is held on from now on; `on`: it was on already."""
        self._held[node] = now, on

    def release(self, node: int) -> tuple[float, bool, int]:
        """A radio is no longer held; returns since when it was, whether it was on before, and its level now."""
        since, on = self._held.pop(node)
        return since, on, self._duty_level.get(node, 0)

    def set_duty(self, node: int, index: int) -> int:
        """A node follows another duty; returns the level of that."""
        self._duty_level[node] = level = level_of(index)
        return level

    def add(self, node: int, listened: float, switched: float) -> None:
        """Add joules of listening and of switching to the cost of a node's duty; take them off if negative."""
        self._listened[node] += listened
        self._switched[node] += switched

    def of(self, node: int) -> tuple[float, float]:
        """Joules of listening and of switching that were added since a node was settled."""
        return (self._listened[node], self._switched[node]) if self.active else (0.0, 0.0)

    def with_added(self, node: int, charges: Charges) -> list[tuple[int, float]]:
        """The charges of a node's duty, listening and switching, with what was added."""
        (_, listened), (_, switched) = charges
        return [(IDLE, listened + self._listened[node]), (SWITCH, switched + self._switched[node])]

    def settle(self, node: int, charges: Charges, awake: float, level: int) -> None:
        """Keep what was taken off of more than there was. `awake`: s for which a node with a schedule was awake."""
        self._listened[node], self._switched[node] = (min(joules, 0.0) for _, joules in charges)
        if node in self._scheduled:
            self._awake[level] += awake

    def enter(self, node: int, level: int, scheduled: bool) -> None:
        """A settled node is at a level from now on; `scheduled`: it follows a sleep schedule."""
        self._scheduled.pop(node, None)
        if scheduled and level:
            self._scheduled[node] = level

    def forget(self, node: int) -> None:
        """Forget a node that goes down: its radio starts again at level 0."""
        self._held.pop(node, None)
        self._duty_level.pop(node, None)

    def awake(self, duty_cycles: DutyCycles, settled_at: Floats, now: float) -> list[float]:
        """For each level, seconds for which nodes with schedules were awake at it. Level 0 is left out."""
        result = list(self._awake)
        if self._scheduled:
            nodes = np.fromiter(self._scheduled, np.int64)
            awake, _ = duty_cycles.tally(nodes, settled_at[nodes], now)
            for level, seconds in zip(self._scheduled.values(), awake.tolist(), strict=True):
                result[level] += seconds
        return result if self.active else []
