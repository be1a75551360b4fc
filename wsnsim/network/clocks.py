"""The clocks of nodes: how far drift and steps have put them ahead of true time.

    clocks.rate(node)                    seconds on the clock per true second: a timer of T s lasts T / rate
    clocks.error(nodes, time) -> (n,)    seconds by which each clock is ahead of true time

The rate of a clock is a function of the random key and the number of the node alone. Perfect clocks cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.radio import Clock
from wsnsim.base.rng import derive_all


class Clocks:
    """The clocks of `size` nodes. All show the true time at the start (our choice: the network was synchronised)."""

    def __init__(self, model: Clock, key: int, size: int) -> None:
        rates = model.rates(derive_all(key, np.arange(size)))
        self._largest_drift = float(np.abs(rates - 1.0).max(initial=0.0))
        self._rates: Floats | None = rates if self._largest_drift > 0.0 else None
        self._steps: dict[int, float] = {}

    @property
    def drift(self) -> bool:
        """Whether any clock runs at another rate than true time."""
        return self._rates is not None

    def rate(self, node: int) -> float:
        """Seconds that pass on the clock of a node per true second. Backoffs and beacon periods depend on it."""
        return 1.0 if self._rates is None else float(self._rates[node])

    def lasts(self, node: int, seconds: float) -> float:
        """True seconds for which a timer of a node runs that is set to `seconds`."""
        return seconds if self._rates is None else seconds / float(self._rates[node])

    def step(self, nodes: Iterable[int], offset: float) -> None:
        """Put the clocks of nodes forward by `offset` seconds; back if it is negative."""
        for node in nodes:
            self._steps[node] = self._steps.get(node, 0.0) + offset

    def error(self, nodes: Ints, time: float) -> Floats:
        """(n,) seconds by which the clocks of nodes are ahead at a true time: (rate - 1) time + steps."""
        ahead = np.zeros(len(nodes)) if self._rates is None else (self._rates[nodes] - 1.0) * time
        if self._steps:
            ahead = ahead + np.array([self._steps.get(node, 0.0) for node in nodes.tolist()])
        return ahead

    def largest_error(self, time: float) -> float:
        """An upper bound in s on the error of every clock, in either direction, at a true time."""
        return self._largest_drift * time + max(map(abs, self._steps.values()), default=0.0)
