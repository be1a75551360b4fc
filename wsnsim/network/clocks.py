"""The clocks of nodes: how far drift, steps and corrections have put them ahead of true time.

    clocks.rate(node)                     seconds on the oscillator per true second: a timer of T s lasts T / rate
    clocks.error(nodes, time) -> (n,)     seconds by which each clock is ahead of true time
    clocks.local_times(nodes, time) -> (n,)     what the clocks show      clocks.true_time(node, local) -> true time
    clocks.correct(node, offset, rate)    what time synchronisation does

Every node has an *own clock*: its oscillator, which drifts, and which a fault may step. Its *clock* is what schedules
and time stamps depend on: the own clock with all corrections. Both are linear functions of true time between two
changes. The rate of an oscillator is a function of the random key and the number of the node alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.radio import Clock, StartsWithOffsets
from wsnsim.base.rng import derive_all


class Clocks:
    """The clocks of `size` nodes. Unless the model has offsets, all show the true time at the start (our choice).

    `env` gives the time of corrections; without it they are made at time 0.

    Attributes:
        perfect: Whether every clock has shown the true time so far, and will until it is stepped.
        on_step: Called with each node whose clock was stepped or corrected, after the change.
    """

    def __init__(self, model: Clock, key: int, size: int, env: simpy.Environment | None = None) -> None:
        self._env = simpy.Environment() if env is None else env
        self._size = size
        keys = derive_all(key, np.arange(size))
        rates = model.rates(keys)
        self._rates, self._own_slopes = rates, rates - 1.0
        self._own_bases = model.offsets(keys) if isinstance(model, StartsWithOffsets) else np.zeros(size)
        self._slopes, self._bases = self._own_slopes.copy(), self._own_bases.copy()
        self._largest_drift = float(np.abs(self._own_slopes).max(initial=0.0))
        self.perfect = not self._largest_drift and not self._own_bases.any()
        self._on_own_slopes = True
        self._corrected: dict[int, float] = {}
        self.on_step: list[Callable[[int], None]] = []

    def rate(self, node: int) -> float:
        """Seconds that pass on the oscillator of a node per true second. Backoffs and beacon periods depend on it."""
        return float(self._rates[node])

    def lasts(self, node: int, seconds: float) -> float:
        """True seconds for which a timer of a node runs that is set to `seconds`."""
        return seconds / float(self._rates[node])

    def error(self, nodes: Ints, time: float) -> Floats:
        """(n,) seconds by which the clocks of nodes are ahead at a true time, by what is known of them now."""
        ahead: Floats = self._slopes[nodes] * time + self._bases[nodes]
        return ahead

    def local_times(self, nodes: Ints, time: float) -> Floats:
        """(n,) what the clocks of nodes show at a true time, in s."""
        return time + self.error(nodes, time)

    def true_time(self, node: int, local: float) -> float:
        """The true time in s at which the clock of a node shows `local`, if nothing changes it before."""
        return (local - float(self._bases[node])) / (1.0 + float(self._slopes[node]))

    def local_time(self, node: int, time: float | None = None) -> float:
        """What the clock of a node shows at a true time, in s; None: now."""
        time = self._env.now if time is None else time
        return time + self._error_of(node, time)

    def raw_time(self, node: int) -> float:
        """What the own clock of a node shows now, in s: its clock, had it never been corrected."""
        return self._env.now + self._own_error(node)

    def error_lines(self, nodes: Ints) -> tuple[Floats, Floats]:
        """((n,) b in s, (n,) m) of the errors b + m t of nodes, from their last change on."""
        return self._bases[nodes], self._slopes[nodes]

    def step(self, nodes: Iterable[int], offset: float) -> None:
        """Put the own clocks of nodes, and their clocks, forward by `offset` seconds; back if it is negative."""
        self.perfect = False
        for node in nodes:
            self._bases[node] += offset
            self._own_bases[node] += offset
            self._changed(node)

    def correct(self, node: int, offset: float, rate: float | None = None) -> None:
        """Put the clock of a node forward by `offset` seconds from now on; back if it is negative.

        While every clock shows the true time this does nothing: perfect clocks need no correction.

        Args:
            node: The node.
            offset: In s.
            rate: Estimated seconds on its oscillator per second of the time that it is synchronised to: the clock goes
                slower by this factor than the oscillator. None: the last estimate.
        """
        if self.perfect:
            return
        ahead, slope = self._error_of(node, self._env.now) + offset, float(self._slopes[node])
        self._corrected[node] = self.corrected(node) + offset
        self._follow(node, ahead, slope if rate is None else self.rate(node) / rate - 1.0)

    def corrected(self, node: int) -> float:
        """Seconds by which corrections have put the clock of a node forward at once, all together."""
        return self._corrected.get(node, 0.0)

    def forget(self, node: int) -> None:
        """A node has lost its corrections: its clock is its own clock again."""
        if not self.perfect:
            self._follow(node, self._own_error(node), float(self._own_slopes[node]))
            self._corrected.pop(node, None)

    def _follow(self, node: int, ahead: float, slope: float) -> None:
        """The clock of a node is ahead by `ahead` s now, and its error grows by `slope` s per true second."""
        self._on_own_slopes = False
        self._bases[node] = ahead - slope * self._env.now
        self._slopes[node] = slope
        self._changed(node)

    def _changed(self, node: int) -> None:
        for action in self.on_step:
            action(node)

    def _error_of(self, node: int, time: float) -> float:
        return float(self._slopes[node]) * time + float(self._bases[node])

    def _own_error(self, node: int) -> float:
        return float(self._own_slopes[node]) * self._env.now + float(self._own_bases[node])

    def largest_error(self, time: float) -> float:
        """An upper bound in s on the error of every clock, in either direction, at a true time."""
        if self.perfect:
            return 0.0
        if not self._on_own_slopes:
            return float(np.abs(self.error(np.arange(self._size), time)).max(initial=0.0))
        return self._largest_drift * time + float(np.abs(self._bases).max(initial=0.0))
