"""Sample paths of a network's life: quiet power all the time, visits at random, and the batteries that they drain.

    paths = Paths(stores, visits, rng, count, horizon)
    paths.advance(phase, deaths)        until so many nodes of each path are dead, or the horizon

Between two deaths a network is memoryless: what disjoint visits take adds up. So a path needs only how often each visit
of the library happens in a chunk of time, and all paths advance together. A chunk takes at most `CHUNK` of a battery;
within it, power is constant. Where a visit takes more, each visit is a chunk of its own.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.lifetimes.stores import Stores
from wsnsim.models.visits import Visits

CHUNK: Final = 0.004
"""Largest share of a battery that a chunk of several visits takes on average."""
LONGEST: Final = 0.004
"""Longest chunk without visits, as a share of the horizon."""


class Phase(NamedTuple):
    """What drains batteries while the same nodes are dead.

    Attributes:
        quiet: (N,) power of each node without a target in W.
        added: (K, N) what each visit of the library adds in J.
        seconds: (K,) how long each visit lasts.
        loads: (R, N) mean joules of a visit in each path.
    """

    quiet: Floats
    added: Floats
    seconds: Floats
    loads: Floats


class Paths:
    """R sample paths of a network of N nodes.

    Args:
        stores: the batteries of the nodes.
        visits: when targets come; None: never.
        rng: source of all random numbers.
        count: R.
        horizon: end of all paths in s.

    Attributes:
        time: (R,) present time of each path in s.
        alive: (R, N) which nodes are alive.
        events: [path, node, time (s), whether the node came back] of each death and return, in no order.
    """

    def __init__(
        self, stores: Stores, visits: Visits | None, rng: np.random.Generator, count: int, horizon: float
    ) -> None:
        self._stores, self._visits, self._rng, self._horizon = stores, visits, rng, horizon
        self._state = stores.full(count)
        self._next = 0
        self.time = np.zeros(count)
        self.alive = np.repeat(stores.alive[None], count, axis=0)
        self.events: list[Floats] = []

    def advance(self, phase: Phase, deaths: int) -> None:
        """Continue every path until it has this number of dead nodes, or the horizon has come."""
        while (chosen := self._going(deaths)).size:
            begun = self.time[chosen]
            if self._visits is None:
                self._spend(chosen, phase.quiet, np.minimum(LONGEST * self._horizon, self._horizon - begun))
            elif self._visits.times is not None:
                self._listed(chosen, phase)
            else:
                self._random(chosen, phase, self._visits)

    def _going(self, deaths: int) -> np.ndarray:
        """The paths that are not finished."""
        return np.flatnonzero(((~self.alive).sum(axis=1) < deaths) & (self.time < self._horizon))

    def _random(self, chosen: np.ndarray, phase: Phase, visits: Visits) -> None:
        """One chunk of random visits in each of the paths."""
        assert visits.rate is not None
        lasts = self._stores.least_life(phase.quiet + visits.rate * phase.loads.mean(axis=0))
        count = max(1, min(int(CHUNK * lasts * visits.rate), 10_000_000))
        begun = self.time[chosen]
        waits = self._rng.gamma(count, size=chosen.size)
        counts = self._rng.multinomial(count, np.full(len(phase.added), 1.0 / len(phase.added)), size=chosen.size)
        gaps, stay = visits.after(begun, waits) - begun, counts @ phase.seconds
        joules = self._joules(counts, phase, chosen)
        if count > 1:
            span = gaps + stay
            self._spend(chosen, phase.quiet + joules / span[:, None], span)
            return
        self._spend(chosen, phase.quiet, gaps)
        self._spend(chosen, phase.quiet + joules / stay[:, None], stay)

    def _listed(self, chosen: np.ndarray, phase: Phase) -> None:
        """The next of the listed visits in each of the paths, or the quiet time until the horizon."""
        assert self._visits is not None and self._visits.times is not None
        times = np.array([*self._visits.times, math.inf])
        begins = times[np.searchsorted(times, self.time[chosen])]
        coming = begins < self._horizon
        self._spend(chosen, phase.quiet, np.minimum(begins, self._horizon) - self.time[chosen])
        going = chosen[coming]
        if going.size:
            counts = np.eye(len(phase.added))[self._rng.integers(len(phase.added), size=going.size)]
            stay = counts @ phase.seconds
            self._spend(going, phase.quiet + self._joules(counts, phase, going) / stay[:, None], stay)

    def _joules(self, counts: Floats, phase: Phase, chosen: np.ndarray) -> Floats:
        """(n, N) what visits of the library take, scaled to the mean loads of the paths."""
        mean = phase.added.mean(axis=0)
        loads, known = phase.loads[chosen], mean > 0.0
        factors = np.where(known, loads / np.where(known, mean, 1.0), 0.0)
        unknown = np.where(known, 0.0, loads) * counts.sum(axis=1, keepdims=True)
        return (counts @ phase.added) * factors + unknown

    def _spend(self, chosen: np.ndarray, watts: Floats, seconds: Floats) -> None:
        """Drain the batteries of the paths for a time each, and note the nodes that die or come back."""
        if not chosen.size:
            return
        watts = np.broadcast_to(np.maximum(watts, 0.0), (chosen.size, self.alive.shape[1]))
        before: Bools = self.alive[chosen]
        state = {name: values[chosen] for name, values in self._state.items()}
        after, alive, changed = self._stores.advance(state, before, watts, seconds[:, None])
        for name, values in after.items():
            self._state[name][chosen] = values
        row, node = np.nonzero(alive != before)
        when = self.time[chosen][row] + changed[row, node]
        self.events.append(np.column_stack([chosen[row], node, when, alive[row, node]]))
        self.alive[chosen] = alive
        self.time[chosen] += seconds
