"""How far the nodes' clocks have run from true time: what drift and steps have added up to.

    clocks.rate(node)                    seconds on its clock in one true second: a timer of T lasts T / rate
    clocks.error(nodes, time) -> (n,)    seconds by which each clock is ahead of true time

A node's rate is a function of the stream's key and its number alone. True clocks cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.radio import Clock
from wsnsim.base.rng import derive_all


class Clocks:
    """The clocks of `size` nodes. All show the true time at the start (our choice: the network was synchronised)."""

    def __init__(self, part: Clock, key: int, size: int) -> None:
        rates = part.rates(derive_all(key, np.arange(size)))
        self._worst = float(np.abs(rates - 1.0).max(initial=0.0))
        self._rates: Floats | None = rates if self._worst > 0.0 else None
        self._steps: dict[int, float] = {}

    @property
    def drift(self) -> bool:
        """Whether any clock runs at another rate than true time."""
        return self._rates is not None

    def rate(self, node: int) -> float:
        """Seconds that pass on a node's clock in one true second: backoffs and periods of beacons are by it."""
        return 1.0 if self._rates is None else float(self._rates[node])

    def lasts(self, node: int, seconds: float) -> float:
        """True seconds that a node's timer of so many seconds runs."""
        return seconds if self._rates is None else seconds / float(self._rates[node])

    def step(self, nodes: Iterable[int], offset: float) -> None:
        """The clocks of nodes are put forward by `offset` seconds; back, if it is negative."""
        for node in nodes:
            self._steps[node] = self._steps.get(node, 0.0) + offset

    def error(self, nodes: Ints, time: float) -> Floats:
        """(n,) seconds by which the nodes' clocks are ahead at a true time: (rate - 1) time + steps."""
        ahead = np.zeros(len(nodes)) if self._rates is None else (self._rates[nodes] - 1.0) * time
        if self._steps:
            ahead = ahead + np.array([self._steps.get(node, 0.0) for node in nodes.tolist()])
        return ahead

    def most(self, time: float) -> float:
        """Seconds by which no clock is farther from true time, either way."""
        return self._worst * time + max(map(abs, self._steps.values()), default=0.0)
