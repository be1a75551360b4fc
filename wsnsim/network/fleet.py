"""All nodes as arrays: where they stand, who lives, and the ledger of every joule by node and cause.

What was *spent* is stored, what is left is derived, so the ledger closes: for each node the sum over causes is what
it spent. Books are opened at a node's first joule; a node that never does anything costs nothing. Reading energy
changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.tables import CAUSE, CAUSES

ELECTRONICS, AMPLIFIER = CAUSE["tx_electronics"], CAUSE["tx_amplifier"]
RECEIVE, IDLE = CAUSE["rx"], CAUSE["idle"]
SPENT: Final = len(CAUSES)


class Fleet:
    """The nodes. `on_death(node)` is called at the instant a charge reaches zero."""

    def __init__(self, positions: Floats, traits: Floats, battery: float, reach: float) -> None:
        self.positions = positions
        self.traits = traits
        self.size = len(positions)
        self.x: list[float] = positions[:, 0].tolist()
        self.y: list[float] = positions[:, 1].tolist()
        self.battery = battery
        self.alive: list[bool] = [True] * self.size
        self.died_at: dict[int, float] = {}
        self.books: dict[int, list[float]] = {}
        self.totals: list[float] = [0.0] * len(CAUSES)
        self.tree = KDTree(positions)
        self.reach = reach
        self.on_death: Callable[[int], None] = lambda node: None
        self._neighbours: dict[int, list[int]] = {}

    def neighbours(self, node: int) -> list[int]:
        """Ids within the link's reach of a node, ascending, itself left out, the dead included."""
        found = self._neighbours.get(node)
        if found is None:
            found = sorted(self.tree.query_ball_point(self.positions[node], self.reach))
            found.remove(node)
            self._neighbours[node] = found
        return found

    def distance(self, a: int, b: int) -> float:
        """Metres between two nodes."""
        dx, dy = self.x[a] - self.x[b], self.y[a] - self.y[b]
        return float((dx * dx + dy * dy) ** 0.5)

    def spend(self, node: int, cause: int, joules: float) -> float:
        """Book joules on a living node; give what was spent: less if the charge did not suffice, and it died."""
        book = self.books.get(node)
        if book is None:
            book = self.books[node] = [0.0] * (SPENT + 1)
        left = self.battery - book[SPENT]
        if joules >= left:
            self._exhaust(node, book, ((cause, left),))
            return left
        book[cause] += joules
        book[SPENT] += joules
        self.totals[cause] += joules
        return joules

    def spend_transmit(self, node: int, electronics: float, amplifier: float, bits: int) -> int:
        """Book a transmission on its two causes; give the whole bits that were paid: fewer if the node died of it."""
        book = self.books.get(node)
        if book is None:
            book = self.books[node] = [0.0] * (SPENT + 1)
        joules = electronics + amplifier
        left = self.battery - book[SPENT]
        if joules >= left:
            paid = int(bits * left / joules)
            share = paid / bits
            self._exhaust(node, book, ((ELECTRONICS, electronics * share), (AMPLIFIER, amplifier * share)))
            return paid
        book[ELECTRONICS] += electronics
        book[AMPLIFIER] += amplifier
        book[SPENT] += joules
        self.totals[ELECTRONICS] += electronics
        self.totals[AMPLIFIER] += amplifier
        return bits

    def spend_receive(self, node: int, joules: float, bits: int) -> int:
        """Book a reception; give the whole bits that were paid: fewer if the node died of it."""
        book = self.books.get(node)
        if book is None:
            book = self.books[node] = [0.0] * (SPENT + 1)
        left = self.battery - book[SPENT]
        if joules >= left:
            paid = int(bits * left / joules)
            self._exhaust(node, book, ((RECEIVE, joules * paid / bits),))
            return paid
        book[RECEIVE] += joules
        book[SPENT] += joules
        self.totals[RECEIVE] += joules
        return bits

    def _exhaust(self, node: int, book: list[float], charges: tuple[tuple[int, float], ...]) -> None:
        """A node's last charges. What remains, less than a bit's worth, is lost: booked as idle."""
        rest = self.battery - book[SPENT] - sum(joules for _, joules in charges)
        for cause, joules in (*charges, (IDLE, max(rest, 0.0))):
            book[cause] += joules
            self.totals[cause] += joules
        book[SPENT] = self.battery
        self.alive[node] = False
        self.on_death(node)

    def left(self, node: int) -> float:
        """Joules left in a node."""
        book = self.books.get(node)
        return self.battery - book[SPENT] if book else self.battery

    def able(self, threshold: float) -> Bools:
        """(N,) which nodes live and hold more than `threshold` joules."""
        result = np.full(self.size, self.battery > threshold)
        for node, book in self.books.items():
            if self.battery - book[SPENT] <= threshold:
                result[node] = False
        return result

    def all_left(self) -> Floats:
        """(N,) joules left."""
        result = np.full(self.size, self.battery)
        for node, book in self.books.items():
            result[node] = self.battery - book[SPENT]
        return result
