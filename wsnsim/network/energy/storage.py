"""Batteries in a run: what nodes have at the start, what they can draw now, and what is lost and harvested meanwhile.

The ledger's `spent` of a node is such that the full charge less that is what it can draw at once. Spending lowers it by
as much. What time does to it is found when the node is settled: its load since then is taken as constant,
apart from what was spent at once.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.batteries import Advance, Battery, BatteryState
from wsnsim.base.tables import CAUSE
from wsnsim.network.energy.ledger import EnergyLedger

STRANDED: Final = CAUSE["stranded"]
LOST: Final = (("leaked", CAUSE["self_discharge"]), ("unstored", CAUSE["unstored"]), ("surplus", CAUSE["surplus"]))
ROUNDING: Final = 1e-12
"""Share of a charge that is rounding error."""


class BatteryRates(NamedTuple):
    """What changes a battery beside the load: self-discharge and what is stored, in W, and when the latter changes."""

    leak: float = 0.0
    stored: float = 0.0
    until: float = math.inf


class Storage:
    """The batteries of a run that are not all of `energy.battery`, and nothing else.

    Attributes:
        initial: (N,) J in each at the start.
        harvested: (N,) J offered by harvesters.
        full: J that the fullest finite battery gives at once at the start; what others lack of it counts as `spent`.
        timed: Whether time changes what can be drawn.
        empty: Nodes without charge that will start again.
        restarts: Whether nodes whose battery is empty start again.
    """

    def __init__(self, battery: Battery, state: BatteryState, env: simpy.Environment) -> None:
        self._battery, self._state, self._env = battery, state, env
        size = state.left.size
        self.initial = state.left.copy()
        drawable = battery.drawable(state)
        finite = np.isfinite(drawable)
        self.full = float(drawable.max(where=finite, initial=0.0)) if finite.any() else math.inf
        income = battery.income(0.0)
        self._harvests = income.watts > 0.0 or income.until < math.inf
        self.timed = self._harvests or state.uneven.size > 0 or bool(state.leak.any())
        self.restarts = battery.restart is not None
        self.empty: set[int] = set()
        self.harvested = np.zeros(size)
        self._at, self._known = np.zeros(size), np.zeros(size)

    def begin(self, ledger: EnergyLedger) -> None:
        """Note in a fresh ledger what each node lacks of the full charge."""
        self._ledger = ledger
        ledger.spent[:] = self._known[:] = self._lacks(self._state)
        ledger.ceiling = float(ledger.spent.max(initial=0.0))

    @property
    def least(self) -> float:
        """J below which no node starts; none that time changes is sure of any."""
        return 0.0 if self.timed else self.full - float(self._ledger.spent.max(initial=0.0))

    def elapse(self, node: int, joules: float, up: bool = True) -> float:
        """A node has consumed joules, evenly since this was called last; returns what its battery gave of them.

        Losses are booked; the joules are not, but what can be drawn is that after them.
        """
        since, now, given = float(self._at[node]), self._env.now, 0.0
        if since == now and not joules:
            return given
        state, elapsed = self._now(slice(node, node + 1)), now - since
        if joules and not elapsed:
            given = min(joules, float(self._battery.drawable(state)[0]))
            state = self._battery.draw_at_once(state, np.array([given]))
        while since < now:
            income = self._battery.income(since)
            until = min(max(income.until, math.nextafter(since, math.inf)), now)
            done = self._battery.advance(state, np.array([joules / elapsed]), until - since, income.watts)
            self._book(node, done)
            state, since, given = done.state, until, given + float(done.spent[0])
            if up and math.isfinite(done.died_after[0]):
                break
        self._at[node] = now
        for column, value in zip(self._state, state, strict=True):
            column[..., node] = value[..., 0]
        self._ledger.spent[node] = self._known[node] = self._lacks(self._state.of(slice(node, node + 1)))[0]
        return given

    def _book(self, node: int, done: Advance) -> None:
        self.harvested[node] += done.harvested[0]
        for name, cause in LOST:
            if joules := float(getattr(done, name)[0]):
                self._ledger.joules[cause][node] += joules
                self._ledger.totals[cause] += joules

    def _lacks(self, state: BatteryState) -> Floats:
        """(n,) J by which what can be drawn is less than the full charge; on mains infinitely much more is there."""
        drawable = self._battery.drawable(state)
        lacks = np.full(drawable.shape, -math.inf if self.full < math.inf else 0.0)
        np.subtract(self.full, drawable, where=np.isfinite(drawable), out=lacks)
        return lacks

    def _now(self, nodes: Ints | slice) -> BatteryState:
        """The state of nodes after what they spent at once since they were settled."""
        state, known = self._state.of(nodes), self._known[nodes]
        at_once = np.zeros(known.shape)
        np.subtract(self._ledger.spent[nodes], known, where=np.isfinite(known), out=at_once)
        return self._battery.draw_at_once(state, at_once)

    def left(self, nodes: Ints, pending: Floats) -> Floats:
        """(n,) J in the batteries of nodes that have consumed `pending` J since they were settled. Changes nothing."""
        if not self.timed:
            left: Floats = self.initial[nodes] - self._ledger.joules[:, nodes].sum(axis=0) - pending
            return left
        seconds = self._env.now - self._at[nodes]
        watts: Floats = np.divide(pending, seconds, where=seconds > 0.0, out=np.zeros(len(nodes)))
        income = self._battery.income(self._env.now).watts
        return self._battery.advance(self._now(nodes), watts, seconds, income).state.left

    def lose_rest(self, node: int) -> None:
        """A node is dead: what is left in its battery is stranded."""
        had = self.initial[node] + self.harvested[node]
        rest = had - float(self._ledger.joules[:, node].sum())
        if rest > ROUNDING * had:
            self._ledger.joules[STRANDED][node] += rest
            self._ledger.totals[STRANDED] += rest
        self._state.left[node], self._known[node] = 0.0, self._ledger.spent[node]

    def supply(self, node: int) -> BatteryRates:
        """What changes the battery of a node from now on, beside its load."""
        income = self._battery.income(self._env.now)
        return BatteryRates(float(self._state.leak[node]), income.watts * self._battery.stored, income.until)

    def needs(self, node: int) -> float:
        """J that an empty node lacks to start again; none if it may start."""
        state = self._now(slice(node, node + 1))
        level = float(state.capacity[0]) * (self._battery.restart or 0.0) * (1.0 - ROUNDING)
        return max(level - float(state.left[0]), 0.0)

    def charged_at(self, node: int) -> float:
        """The time in s at which an empty node may start again, or at which what it harvests changes."""
        supply = self.supply(node)
        gains = supply.stored - supply.leak
        charged = self._env.now + self.needs(node) / gains if gains > 0.0 else math.inf
        return min(charged, supply.until)
