"""Sample paths of a network's life: quiet power all the time, visits at random, and the batteries that they drain.

    paths = Paths(stores, visits, rng, count, horizon)
    paths.advance(phase, deaths)        until so many nodes of each path are dead, or the horizon

Between two deaths a network is memoryless: what disjoint visits take adds up. So a path needs only how often each visit
of the library happens in a chunk of time, and all paths advance together. A chunk takes at most `CHUNK` of a battery;
within it, power is constant. Where a visit takes more, each visit is a chunk of its own.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.lifetimes.stores import Stores
from wsnsim.models.visits import Visits

CHUNK: Final = 0.004
"""Share of the life of the node with the shortest life that a chunk of several visits takes on average."""
FINEST: Final = 2e-4
"""The same of the median life, where some nodes have next to nothing: chunks are no shorter than that."""
LONGEST: Final = 0.004
"""Longest chunk, as a share of the horizon."""


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
        visits: when targets come.
        rng: source of all random numbers.
        count: R.
        horizon: end of all paths in s.

    Attributes:
        time: (R,) present time of each path in s.
        alive: (R, N) which nodes are alive.
        events: [path, node, time (s), whether the node came back] of each death and return, in no order.
    """

    def __init__(self, stores: Stores, visits: Visits, rng: np.random.Generator, count: int, horizon: float) -> None:
        self._stores, self._visits, self._rng, self._horizon = stores, visits, rng, horizon
        self._state = stores.full(count)
        self.time = np.zeros(count)
        self.alive = np.repeat(stores.alive[None], count, axis=0)
        self.events: list[Floats] = []

    def advance(self, phase: Phase, deaths: int) -> None:
        """Continue every path until it has this number of dead nodes, or the horizon has come."""
        while (chosen := self._going(deaths)).size:
            if self._visits.rate is None:
                self._listed(chosen, phase)
            else:
                self._random(chosen, phase)

    def noted(self) -> Floats:
        """(E, 4) the events so far."""
        return np.concatenate([np.zeros((0, 4)), *self.events])

    def _going(self, deaths: int) -> np.ndarray:
        """The paths that are not finished. Where nothing can change any more, the horizon has come."""
        if not self._stores.restarts:
            mortal = self.alive & np.isfinite(self._stores.joules)
            self.time[~mortal.any(axis=1)] = self._horizon
        return np.flatnonzero(((~self.alive).sum(axis=1) < deaths) & (self.time < self._horizon))

    def _random(self, chosen: np.ndarray, phase: Phase) -> None:
        """One chunk of random visits in each of the paths."""
        count = self._in_chunk(phase)
        shares = np.full(len(phase.added), 1.0 / len(phase.added))
        counts = self._rng.multinomial(count, shares, size=chosen.size).astype(np.float64)
        stay, begun = counts @ phase.seconds, self.time[chosen]
        ends = self._visits.after_several(begun, count, self._rng.gamma(count, size=chosen.size), stay)
        joules = self._joules(counts, phase, chosen)
        if count == 1:
            self._spend(chosen, phase.quiet, ends - begun - stay)
            begun = ends - stay
        self._spend(chosen, phase.quiet + joules / (ends - begun)[:, None], ends - begun)

    def _in_chunk(self, phase: Phase) -> int:
        """The number of visits in a chunk, at least 1."""
        rate = self._visits.rate
        assert rate is not None
        living = self.alive.any(axis=0) & np.isfinite(self._stores.joules)
        lives = self._stores.lives(phase.quiet + rate * phase.loads.mean(axis=0))[living]
        span = LONGEST * self._horizon
        if lives.size:
            span = min(span, max(CHUNK * float(lives.min()), FINEST * float(np.median(lives))))
        return max(1, int(span * rate))

    def _listed(self, chosen: np.ndarray, phase: Phase) -> None:
        """The next of the listed visits in each of the paths, or the quiet time until the horizon."""
        times = np.append(self._visits.begins, np.inf)
        now = self.time[chosen]
        begins = times[np.searchsorted(times, now)]
        until = np.minimum(np.minimum(begins, self._horizon), now + LONGEST * self._horizon)
        coming = (begins <= until) & (begins < self._horizon)
        self._spend(chosen, phase.quiet, until - now)
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
        joules: Floats = (counts @ phase.added) * factors + unknown
        return joules

    def _spend(self, chosen: np.ndarray, watts: Floats, seconds: Floats) -> None:
        """Drain the batteries of the paths for a time each, and note the nodes that die or come back."""
        nodes = self.alive.shape[1]
        watts = np.broadcast_to(np.maximum(watts, 0.0), (chosen.size, nodes))
        while chosen.size:
            begun = self.time[chosen]
            piece = np.minimum(seconds, self._stores.piece(begun))
            columns = (chosen[:, None] * nodes + np.arange(nodes)).ravel()
            alive: Bools = self.alive[chosen]
            begins, lasts = np.repeat(begun, nodes), np.repeat(piece, nodes)
            now = self._state.of(columns)
            change = self._stores.advance(now, alive.ravel(), watts.ravel(), begins, lasts)
            for column, values in zip(self._state, change.state, strict=True):
                column[..., columns] = values
            path, node = np.divmod(columns[change.column], nodes)
            self.events.append(np.column_stack([path, node, begins[change.column] + change.after, change.back]))
            self.alive[chosen] = change.alive.reshape(alive.shape)
            self.time[chosen] += piece
            rest = piece < seconds
            chosen, watts, seconds = chosen[rest], watts[rest], (seconds - piece)[rest]
