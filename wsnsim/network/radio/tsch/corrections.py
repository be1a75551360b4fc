"""Corrections of clocks by those of time parents, and the estimates of their rates.

    corrections.correct(node, source)      corrections.age(node) -> s      corrections.period(node) -> s

A node measures how far its clock is from that of a neighbour in ticks of `mac.tick`, and sets it. If rates are
estimated (`mac.keep_alive_compensated`), what it was corrected by since the last estimate, divided by the time that has
passed, is the error of its rate: its clock goes at the corrected rate from then on. Half a `keep_alive` must have
passed for that; half of `keep_alive_compensated` if it was corrected by several neighbours, whose clocks differ.

The time until it asks for the next correction is doubled, up to `keep_alive_compensated`, as long as corrections are
below half of the guard; a larger one halves it, to not less than `keep_alive`. Each time it is shortened by a random
part of up to a quarter, so that nodes that were corrected by one beacon do not ask at once. Where nodes never ask,
`eb_period` takes the place of `keep_alive`, and rates are not estimated.

Source: Stanislowski, Vilajosana, Wang, Watteyne, Pister (2014), Adaptive Synchronization in IEEE802.15.4e Networks; the
thresholds are ours.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.models.tsch import Tsch
from wsnsim.network.clocks import Clocks

NOBODY: Final = -1
SHARE, AGE, ERROR = 0, 1, 2
SPREAD: Final = 0.25
"""Largest part by which a period is shortened."""
PERIODS: Final = 2.0
KEEP_ALIVES: Final = 4.0
"""A node that was not corrected for as many periods, and for as many `keep_alive`, has lost the time."""
IMPOSSIBLE: Final = 0.1
"""No oscillator is off by this share: the clock was stepped."""
LARGE: Final = 0.5
"""A correction above this share of the guard says that the rate of a clock is not known well enough."""


class Corrections:
    """When and by whom the clocks of nodes were corrected, and what they know of their rates."""

    def __init__(self, mac: Tsch, env: simpy.Environment, clocks: Clocks, size: int, key: int) -> None:
        self._mac = mac
        self._env = env
        self._clocks = clocks
        asks = mac.keep_alive is not None
        self._shortest = mac.keep_alive or mac.eb_period or math.inf
        self._longest = mac.keep_alive_compensated if asks else None
        self._key, self._count = key, 0
        self._shares = 1.0 - SPREAD * uniforms(derive_all(key, np.arange(size)), SHARE)
        self._at = np.full(size, float(env.now))
        self._periods = np.full(size, self._shortest)
        self._rates = np.ones(size)
        self._sources = np.full(size, NOBODY)
        self._since, self._moved = np.full(size, float(env.now)), np.zeros(size)
        self._mixed = np.zeros(size, dtype=np.bool_)

    def begin(self, nodes: Ints, reference: int) -> None:
        """Let nodes begin as in a network that has run for a while.

        They were corrected a random part of their periods ago, and know the rates of their clocks, relative to that of
        the reference, as after a measurement over `keep_alive`: within one tick.
        """
        if math.isinf(self._shortest):
            return
        keys = derive_all(self._key, nodes)
        self._at[nodes] -= uniforms(keys, AGE) * (self._longest or self._shortest)
        if self._longest is None:
            return
        errors: Floats = (2.0 * uniforms(keys, ERROR) - 1.0) * self._mac.tick / self._shortest
        for node, error in zip(nodes.tolist(), errors.tolist(), strict=True):
            self._rates[node] = self._clocks.rate(node) / self._clocks.rate(reference) * (1.0 + error)
            self._clocks.correct(node, 0.0, float(self._rates[node]))
        self._periods[nodes] = self._longest

    def age(self, node: int) -> float:
        """Seconds since a node was last corrected."""
        return self._env.now - float(self._at[node])

    def period(self, node: int) -> float:
        """Seconds after which a node asks for a correction."""
        return self._clocks.lasts(node, float(self._periods[node] * self._shares[node]))

    def lost_after(self, node: int) -> float:
        """Seconds without correction after which a node has lost the time."""
        return max(PERIODS * self.period(node), KEEP_ALIVES * self._shortest)

    def forget(self, node: int) -> None:
        """A node has lost the time: it knows nothing of its rate."""
        self._rates[node], self._periods[node], self._sources[node] = 1.0, self._shortest, NOBODY

    def correct(self, node: int, source: int) -> None:
        """Set the clock of a node by that of a neighbour."""
        now = self._env.now
        both = self._clocks.local_times(np.array([node, source]), now)
        tick = self._mac.tick
        offset = round(float(both[1] - both[0]) / tick) * tick if tick else float(both[1] - both[0])
        self._at[node] = now
        self._count += 1
        self._shares[node] = 1.0 - SPREAD * 2.0**-64 * derive(self._key, node, self._count)
        if self._longest is None:
            self._clocks.correct(node, offset)
            return
        joined = self._sources[node] == NOBODY
        self._mixed[node] |= self._sources[node] != source
        self._sources[node] = source
        if joined:
            self._begin_estimate(node)
            self._clocks.correct(node, offset, float(self._rates[node]))
        else:
            self._clocks.correct(node, offset, self._estimate(node, offset))

    def _estimate(self, node: int, offset: float) -> float:
        """The rate of a node's clock after a correction; a new one, if enough time has passed since the last."""
        assert self._longest is not None, "rates are estimated"
        self._moved[node] += offset
        large = abs(offset) > LARGE * self._mac.guard
        if large:
            self._periods[node] = max(float(self._periods[node]) / 2.0, self._shortest)
        passed = self._env.now - float(self._since[node])
        if passed < (self._longest if self._mixed[node] else self._shortest) / 2.0:
            return float(self._rates[node])
        if not large:
            self._periods[node] = min(2.0 * float(self._periods[node]), self._longest)
        error = float(self._moved[node]) / passed
        if abs(error) < IMPOSSIBLE:
            self._rates[node] *= 1.0 - error
        self._begin_estimate(node)
        return float(self._rates[node])

    def _begin_estimate(self, node: int) -> None:
        """Measure the rate of a clock from now on."""
        self._since[node], self._moved[node], self._mixed[node] = self._env.now, 0.0, False
