"""The energy ledger: the joules that nodes have spent, by node and cause."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, scalars
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.kernels.nodes import book

Charges: TypeAlias = Sequence[tuple[int, float]]
"""Pairs of cause and joules."""
ELECTRONICS, AMPLIFIER, IDLE = CAUSE["tx_electronics"], CAUSE["tx_amplifier"], CAUSE["idle"]
SWITCH = CAUSE["switch"]


def affordable(charges: Charges, left: float) -> Charges:
    """Return what `left` joules pay of larger charges: less of a change of mode, which came last, then of all alike."""
    lasting = sum(amount for cause, amount in charges if cause != SWITCH)
    switching = sum(amount for cause, amount in charges if cause == SWITCH)
    of_lasting = min(left / lasting, 1.0) if lasting else 0.0
    of_switching = min(max(left - lasting, 0.0) / switching, 1.0) if switching else 0.0
    return tuple((cause, amount * (of_switching if cause == SWITCH else of_lasting)) for cause, amount in charges)


class EnergyLedger:
    """The joules that each node has spent on each cause.

    The causes of a node add up to what it has spent. Arrays of zeros take no memory before they are written, so a
    node that never spends anything costs nothing.

    Attributes:
        joules: (causes, N) spent by each node on each cause.
        spent: (N,) spent by each node.
        spent_by: `spent`, for fast access to single nodes.
        totals: Spent by all nodes, one number per cause.
        ceiling: No living node has spent more than this.
    """

    def __init__(self, size: int) -> None:
        self.joules = np.zeros((len(CAUSES), size))
        self.spent = np.zeros(size)
        self.spent_by = scalars(self.spent)
        self.totals: list[float] = [0.0] * len(CAUSES)
        self.ceiling = 0.0
        self._rows = list(self.joules)
        self._by_cause = [scalars(row) for row in self._rows]
        self._uses_of_ceiling = 0

    def book(self, node: int, cause: int, joules: float) -> None:
        """Book joules on one node and cause."""
        self._by_cause[cause][node] += joules
        spent = self.spent_by[node] = self.spent_by[node] + joules
        if spent > self.ceiling:
            self.ceiling = spent
        self.totals[cause] += joules

    def book_transmission(self, node: int, electronics: float, amplifier: float) -> None:
        """Book a transmission on its two causes."""
        self._by_cause[ELECTRONICS][node] += electronics
        self._by_cause[AMPLIFIER][node] += amplifier
        spent = self.spent_by[node] = self.spent_by[node] + (electronics + amplifier)
        if spent > self.ceiling:
            self.ceiling = spent
        self.totals[ELECTRONICS] += electronics
        self.totals[AMPLIFIER] += amplifier

    def book_charges(self, node: int, charges: Charges) -> None:
        """Book joules on several causes of one node."""
        for cause, joules in charges:
            self._by_cause[cause][node] += joules
            self.totals[cause] += joules
        spent = self.spent_by[node] = self.spent_by[node] + sum(joules for _, joules in charges)
        if spent > self.ceiling:
            self.ceiling = spent

    def book_last(self, node: int, charges: Charges, battery: float) -> float:
        """Book the last charges of a node, and what then remains in its battery as idle; returns the latter."""
        rest: float = max(battery - self.spent_by[node] - sum(joules for _, joules in charges), 0.0)
        for cause, joules in (*charges, (IDLE, rest)):
            self._by_cause[cause][node] += joules
            self.totals[cause] += joules
        self.spent_by[node] = battery
        return rest

    def book_same(self, nodes: Ints, cause: int, joules: float) -> None:
        """Book the same joules on different nodes (n,)."""
        book(nodes, joules, self.spent, self._rows[cause])
        self.totals[cause] += joules * nodes.size
        self.ceiling += joules

    def book_each(self, nodes: Ints, cause: int, joules: Floats) -> None:
        """Book joules (n,) on different nodes (n,)."""
        self.joules[cause][nodes] += joules
        self.totals[cause] += float(joules.sum())
        self.spent[nodes] += joules

    def lower_ceiling(self, living: Bools) -> float:
        """Return the ceiling, recomputed from time to time because `book_same` only raises it."""
        self._uses_of_ceiling -= 1
        if self._uses_of_ceiling < 0:
            self._uses_of_ceiling = self.spent.size
            self.ceiling = float(self.spent.max(where=living, initial=0.0))
        return self.ceiling

    def all_below(self, joules: float, nodes: Ints) -> bool:
        """Whether each of the nodes (n,) has spent less than `joules`."""
        return bool((self.spent[nodes] < joules).all())
