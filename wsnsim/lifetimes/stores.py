"""The batteries of a network's nodes over years, in many sample paths: the scenario's battery component in columns.

    stores = draw_stores(setup, sinks, size)      stores.advance(state, alive, watts, begun, seconds) -> Change

A column is one node in one path. Its load is constant in a span. What a harvester offers is averaged over the span; a
`piece` of a span is as long as the rows of the trace, or, where many rows come in the time in which the store hardly
changes, as long as that time.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.batteries import Battery, BatteryState
from wsnsim.base.setups import NetworkSetup

AVERAGED: Final = 0.05
"""Largest share of the smallest store that the income of several rows of a trace fills, if it is averaged."""
TRACED: Final = 3.2e7
"""Time (s) of a trace in which the largest income is looked for: a year."""


class Change(NamedTuple):
    """What a span did to columns, and the changes in it: column, s from the begin of the span, whether it is back."""

    state: BatteryState
    alive: Bools
    column: Ints
    after: Floats
    back: Bools


class Stores:
    """The batteries of N nodes at the start, and what becomes of them.

    Attributes:
        start: (N,) the batteries at the start.
        joules: (N,) J that can be drawn slowly; infinite on mains.
        alive: (N,) which nodes have anything at the start.
    """

    def __init__(self, battery: Battery, start: BatteryState) -> None:
        self._battery, self.start = battery, start
        self.alive: Bools = battery.drawable(start) > 0.0
        self.joules: Floats = np.where(self.alive, start.left - start.reserve, 0.0)
        income = battery.income(0.0)
        self._offers = income.watts > 0.0 or np.isfinite(income.until)
        self._times, self._sums = np.zeros(1), np.zeros(1)
        self._shortest = self._shortest_piece() if self._offers else np.inf

    @property
    def restarts(self) -> bool:
        """Whether nodes whose battery was empty come back."""
        return self._battery.restart is not None

    def full(self, paths: int) -> BatteryState:
        """The state of all paths at the start; columns are those of the first path, then those of the second, ..."""
        return BatteryState(*(np.tile(column, paths) for column in self.start))

    def lives(self, watts: Floats) -> Floats:
        """(N,) s that each node lives at constant power (N,) in W, without a harvester."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.joules > 0.0, self.joules / np.maximum(watts + self.start.leak, 0.0), 0.0)

    def piece(self, begun: Floats) -> Floats:
        """(n,) s after the times `begun` (n,) for which income may be averaged; infinite without a harvester."""
        if not self._offers:
            return np.full(begun.shape, np.inf)
        least = begun + self._shortest
        self._trace(float(least.max()))
        pieces: Floats = self._times[np.searchsorted(self._times, least)] - begun
        return pieces

    def advance(self, state: BatteryState, alive: Bools, watts: Floats, begun: Floats, seconds: Floats) -> Change:
        """What a span does to n columns.

        Args:
            state: at its begin.
            alive: (n,) which nodes are up.
            watts: (n,) load of those in W; the others take nothing.
            begun: (n,) when the span begins, in s.
            seconds: (n,) how long it lasts.
        """
        income = self._mean_income(begun, begun + seconds)
        state, alive, passed = BatteryState(*(column.copy() for column in state)), alive.copy(), np.zeros(len(watts))
        changes: list[tuple[Ints, Floats, Bools]] = []
        going = np.flatnonzero(np.ones_like(alive) if self.restarts else alive)
        while going.size:
            up, part, rest = alive[going], state.of(going), (seconds - passed)[going]
            offered = income[going] if self._offers else 0.0
            until = np.where(up, rest, np.minimum(rest, self._charged(part, offered)))
            done = self._battery.advance(part, np.where(up, watts[going], 0.0), until, offered)
            ended = np.where(up, done.died_after, np.where(until < rest, until, np.inf))
            for column, values in zip(state, done.state, strict=True):
                column[..., going] = values
            changed = np.isfinite(ended)
            passed[going] += np.where(changed, ended, rest)
            going, up = going[changed], up[changed]
            alive[going] = ~up
            changes.append((going, passed[going], ~up))
            going = going[:0] if not self.restarts else going
        changes.append((going[:0], np.zeros(0), alive[:0]))
        return Change(state, alive, *(np.concatenate(each) for each in zip(*changes, strict=True)))

    def _charged(self, state: BatteryState, income: Floats | float) -> Floats:
        """(n,) s until empty stores are charged to the share at which nodes start again."""
        gains = self._battery.stored * income - state.leak
        level = np.where(np.isfinite(state.capacity), state.capacity, 0.0) * (self._battery.restart or 0.0)
        lacks = np.maximum(level - state.left, 0.0)
        seconds: Floats = np.divide(lacks, gains, where=gains > 0.0, out=np.full(gains.shape, np.inf))
        return seconds

    def _mean_income(self, begin: Floats, end: Floats) -> Floats:
        """(n,) W that the harvester offers on average from one time to another."""
        if not self._offers or not end.size:
            return np.zeros(end.shape)
        self._trace(float(end.max()))
        sums = np.interp(end, self._times, self._sums) - np.interp(begin, self._times, self._sums)
        return np.divide(sums, end - begin, where=end > begin, out=np.zeros(end.shape))

    def _trace(self, until: float) -> None:
        """Follow the income beyond a time."""
        if until < self._times[-1]:
            return
        times, sums = [float(self._times[-1])], [float(self._sums[-1])]
        while times[-1] <= 1.2 * until:
            income = self._battery.income(times[-1])
            after = min(income.until, max(2.0 * until, times[-1] + TRACED)) if np.isinf(income.until) else income.until
            after = max(after, float(np.nextafter(times[-1], np.inf)))
            sums.append(sums[-1] + income.watts * (after - times[-1]))
            times.append(after)
        self._times, self._sums = np.append(self._times, times[1:]), np.append(self._sums, sums[1:])

    def _shortest_piece(self) -> float:
        self._trace(TRACED)
        most = float((np.diff(self._sums) / np.diff(self._times)).max())
        finite = self.start.capacity[np.isfinite(self.start.capacity)]
        return AVERAGED * float(finite.min()) / most if most and finite.size else float(TRACED)


def draw_stores(setup: NetworkSetup, size: int, sinks: tuple[int, ...]) -> Stores:
    """The batteries of the network of all runs.

    Raises:
        RunError: they do not fit the network.
    """
    return Stores(setup.battery, setup.battery.draw(setup, size, sinks, setup.streams(0)("battery")))
