"""Which nodes sense and listen when: schedules that are functions of time, and of a counter key a node.

    awake(keys (n,), time) -> (n,)      tally(keys, since (n,), until) -> seconds awake, changes      profile(keys, times)

Nothing is stored, and nobody polls a schedule: a node's awake time over any span is looked up, or summed, when somebody
asks. Times in s, from 0 on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.errors import Fault
from wsnsim.base.part import Quantity, part
from wsnsim.base.problem import Common
from wsnsim.base.radio import Mode
from wsnsim.base.rng import derive_each, uniforms

PERIOD: Final = Quantity("s", ge=1e-2, le=1e9)
ROUNDING: Final = 1e-12
"""Relative: two instants that differ by less are one."""
CHUNK: Final = 1 << 20
"""(node, period) pairs that are looked at together."""


class _NeverAsleep:
    """What schedules have in common that never let the radio sleep."""

    always_listening: ClassVar[bool] = True

    def awake(self, keys: Keys, time: float) -> Bools:
        """(n,) everybody."""
        return np.ones(len(keys), dtype=np.bool_)

    def state(self, keys: Keys, time: float) -> tuple[Bools, Floats, Floats]:
        """Everybody, all of the time."""
        return np.ones(len(keys), dtype=np.bool_), np.zeros(len(keys)), np.full(len(keys), math.inf)

    def tally(self, keys: Keys, since: Floats, until: float) -> tuple[Floats, Floats]:
        """(n,) seconds awake: all; and changes: none."""
        return until - np.asarray(since, dtype=np.float64), np.zeros(len(keys))

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Awake seconds of all nodes until each time (T,), and switches: none."""
        return len(keys) * times, np.zeros(times.size)


@part
class EventWake(_NeverAsleep):
    """A dormant node keeps sensor and receiver on: the target or a frame wakes it (Jiang, Song, Lin 2013, 2.3)."""

    rest: ClassVar[Mode] = Mode.DORMANT


@part
class AlwaysOn(_NeverAsleep):
    """Nobody ever sleeps: receiver and processor stay on. What schedules are measured against."""

    rest: ClassVar[Mode] = Mode.AWAKE


class _Periodic:
    """A schedule whose node k begins a period at each instant phase_k + j T, and is awake for its first part or not.

    A schedule says `_phases(keys)` (n,) in [0, T), `_on(keys, periods)`, whether nodes are awake in periods of theirs,
    which count from 0 for the one that is under way at time 0; and `_length`, the part of such a period, in s.
    """

    always_listening: ClassVar[bool] = False
    rest: ClassVar[Mode] = Mode.SCHEDULED
    period: float

    def awake(self, keys: Keys, time: float) -> Bools:
        """(n,) who is awake at a time."""
        return self.state(keys, time)[0]

    def state(self, keys: Keys, time: float) -> tuple[Bools, Floats, Floats]:
        """Who is awake (n,), and each node's part of a period that a time falls into: from (n,), until (n,)."""
        periods, into = self._place(keys, time)
        start, late = time - into, into >= self._length
        since = np.where(late, start + self._length, start)
        return self._on(keys, periods) & ~late, since, np.where(late, start + self.period, start + self._length)

    def tally(self, keys: Keys, since: Floats, until: float) -> tuple[Floats, Floats]:
        """(n,) seconds awake in [since, until), and changes in (since, until]."""
        seconds, changes, count = np.zeros(len(keys)), np.zeros(len(keys)), len(keys)
        for nodes, starts, on, before in self._history(keys, since, until):
            spell = np.minimum(starts + self._length, until) - np.maximum(starts, since[nodes])
            seconds += np.bincount(nodes[on], np.maximum(spell[on], 0.0), count)
            for who, times in self._changes(nodes, starts, on, before):
                changes += np.bincount(who[(times > since[who]) & (times <= until)], minlength=count)
        return seconds, changes

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Of all nodes together until each of the ascending times (T,): awake seconds and switches, both (T,).

        Each beginning and end of a spell is sorted into its interval once: the cost does not grow with T.
        """
        awake, switches, until = np.zeros(times.size), np.zeros(times.size), float(times[-1]) if times.size else 0.0
        for nodes, starts, on, before in self._history(keys, np.zeros(len(keys)), until):
            awake += _ramps(np.maximum(starts[on], 0.0), times) - _ramps(starts[on] + self._length, times)
            for _, changes in self._changes(nodes, starts, on, before):
                at = np.searchsorted(times, changes[changes > 0.0], side="left")
                switches += np.cumsum(np.bincount(at, minlength=times.size + 1))[: times.size]
        return awake, switches

    def faults(self, parts: Common) -> Iterator[Fault]:
        """A period so short that hardly a frame fits."""
        airtime = getattr(getattr(parts, "mac", None), "airtime", None)
        if airtime is None:
            return
        frame = airtime(parts.mac.bits(parts.mac.payload_bits))  # type: ignore[attr-defined]
        if self._length < 2.0 * frame:
            yield Fault(
                ("sleep", "period"),
                f"nodes would be awake for {1000 * self._length:.3g} ms at a time: not two of the longest frames "
                f"({1000 * frame:.3g} ms) fit",
            )

    def _place(self, keys: Keys, time: float) -> tuple[Ints, Floats]:
        """The number of each node's period at a time, and the seconds since it began."""
        passed = time - self._phases(keys) + self.period
        periods = np.floor(passed / self.period * (1.0 + ROUNDING)).astype(np.int64)
        return periods, np.maximum(passed - periods * self.period, 0.0)

    def _history(self, keys: Keys, since: Floats, until: float) -> Iterator[tuple[Ints, Floats, Bools, Bools]]:
        """Every period of every node that overlaps [since, until], node by node, in chunks.

        (nodes, when the period begins, whether the node is awake in it, whether it was in the one before), (M,) each.
        """
        phases = self._phases(keys)
        first = np.floor((since - phases + self.period) / self.period).astype(np.int64)
        last = np.floor((until - phases + self.period) / self.period).astype(np.int64)
        counts = np.maximum(last - first + 1, 0)
        for chunk in _chunks(counts):
            nodes = np.repeat(np.arange(chunk.start, chunk.stop), counts[chunk])
            begins = np.cumsum(counts[chunk]) - counts[chunk]
            periods = first[nodes] + np.arange(nodes.size) - np.repeat(begins, counts[chunk])
            on = self._on(keys[nodes], periods)
            before = np.concatenate((on[:1], on[:-1]))
            leading = begins[counts[chunk] > 0]
            before[leading] = self._on(keys[nodes[leading]], periods[leading] - 1)
            yield nodes, phases[nodes] + (periods - 1) * self.period, on, before

    def _changes(self, nodes: Ints, starts: Floats, on: Bools, before: Bools) -> Iterator[tuple[Ints, Floats]]:
        """(nodes, times) at which nodes fall asleep or wake."""
        if self._length < self.period:
            yield nodes[on], starts[on]
            yield nodes[on], starts[on] + self._length
        else:
            yield nodes[on != before], starts[on != before]

    def _phases(self, keys: Keys) -> Floats:
        raise NotImplementedError

    def _on(self, keys: Keys, periods: Ints) -> Bools:
        raise NotImplementedError

    @property
    def _length(self) -> float:
        raise NotImplementedError


@part
class RandomIndependent(_Periodic):
    """Random independent sleeping: at the start of each of its own periods a node is awake for it with a probability.

    Nodes' phases are uniform over a period, and their draws independent of one another and of the past.

    Source: Kumar, Lai, Balogh (2004); p and T are our choice, as Li, Jiang, Zhang, Zhang (2012) give none.
    """

    period: Annotated[float, PERIOD, "T_RIS: what a node decides on at a time"] = 10.0
    probability: Annotated[float, Quantity("", ge=0.0, le=1.0), "p: of being awake in a period"] = 0.3

    def _phases(self, keys: Keys) -> Floats:
        return self.period * uniforms(keys, 0)

    def _on(self, keys: Keys, periods: Ints) -> Bools:
        drawn = uniforms(derive_each(keys, (periods + 1).astype(np.uint64)), 0)
        on: Bools = drawn < self.probability
        return on

    @property
    def _length(self) -> float:
        return self.period


@part
class DutyCycle(_Periodic):
    """Each node is awake for the first part of each period: all at the same time, or staggered at random.

    Our choice, for comparison: with the same share of time awake, what matters is who is awake together.
    """

    period: Annotated[float, PERIOD, "from one waking to the next"] = 10.0
    awake_share: Annotated[float, Quantity("", gt=0.0, le=1.0), "part of the period that a node is awake"] = 0.3
    phases: Annotated[Literal["synchronous", "staggered"], "whether all wake together"] = "staggered"

    def _phases(self, keys: Keys) -> Floats:
        return np.zeros(len(keys)) if self.phases == "synchronous" else self.period * uniforms(keys, 0)

    def _on(self, keys: Keys, periods: Ints) -> Bools:
        return np.ones(len(keys), dtype=np.bool_)

    @property
    def _length(self) -> float:
        return self.period * self.awake_share


def _ramps(begins: Floats, times: Floats) -> Floats:
    """(T,) the sum over all beginnings of max(t - beginning, 0)."""
    at = np.searchsorted(times, begins, side="left")
    counts = np.cumsum(np.bincount(at, minlength=times.size + 1))[: times.size]
    sums = np.cumsum(np.bincount(at, begins, times.size + 1))[: times.size]
    return counts * times - sums


def _chunks(counts: Ints) -> Iterator[slice]:
    """Slices of nodes whose counts add up to no more than a chunk, or of one node."""
    ends = np.cumsum(counts)
    begin = 0
    while begin < counts.size:
        done = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, done + CHUNK, side="right")), begin + 1)
        yield slice(begin, end)
        begin = end
