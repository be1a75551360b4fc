"""Which nodes sense and listen when: schedules that are functions of time, and of a counter key a node.

    awake(keys (n,), time) -> (n,)    tally(keys, since (n,), until) -> seconds awake, changes    profile(keys, times)

Nothing is stored, and nobody polls a schedule: a node's awake time over any span is looked up, or summed, when somebody
asks. Times in s, from 0 on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.radio import Mode
from wsnsim.base.rng import derive_each, uniforms
from wsnsim.base.setups import Setup

PERIOD: Final = Quantity("s", ge=1e-2, le=1e9)
MOST_PERIODS: Final = 10_000_000
"""Of a node in a run: each is looked at when its past is told."""
CHUNK: Final = 1 << 16
"""(node, period) pairs that are looked at together: half a megabyte a column, which a processor's cache holds."""


class _NeverAsleep:
    """What schedules have in common that never let the radio sleep."""

    always_listening: ClassVar[bool] = True

    def awake(self, keys: Keys, time: float) -> Bools:
        """(n,) everybody."""
        return np.ones(len(keys), dtype=np.bool_)

    def state(self, keys: Keys, time: float) -> tuple[Bools, Floats, Floats]:
        """Everybody, all of the time."""
        return np.ones(len(keys), dtype=np.bool_), np.zeros(len(keys)), np.full(len(keys), math.inf)

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
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
        phases = self._phases(keys)
        periods = self._number(phases, time)
        starts, following = self._start(phases, periods), self._start(phases, periods + 1)
        on = self._on(keys, periods)
        if not self._sleeps_within:
            return on, starts, following
        ends = starts + self._length
        late = time >= ends
        return on & ~late, np.where(late, ends, starts), np.where(late, following, ends)

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """(n,) seconds awake in [since, until), and changes in (since, until]."""
        seconds, changes, count = np.zeros(len(keys)), np.zeros(len(keys)), len(keys)
        until = np.broadcast_to(np.asarray(until, dtype=np.float64), (count,))
        for nodes, starts, on, before in self._history(keys, since, until):
            spell = np.minimum(starts + self._length, until[nodes]) - np.maximum(starts, since[nodes])
            seconds += np.bincount(nodes[on], np.maximum(spell[on], 0.0), count)
            for who, times in self._changes(nodes, starts, on, before):
                changes += np.bincount(who[(times > since[who]) & (times <= until[who])], minlength=count)
        return seconds, changes

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Of all nodes together until each of the ascending times (T,): awake seconds and switches, both (T,).

        Periods are taken in the order in which they begin, so that running sums need no sorting: the cost is a hash a
        node and period, whatever T. Spells that are over count whole, those under way from their beginning, against
        the first instant of a chunk: sums stay small, and exact. What lies before 0 is taken off at the end.
        """
        asked = np.append(0.0, times)
        awake, switches = np.zeros(asked.size), np.zeros(asked.size)
        for starts, on, before in self._in_order(keys, float(asked[-1])):
            begun = np.searchsorted(starts, asked, side="right")
            over = np.searchsorted(starts + self._length, asked, side="right")
            spells, into = _prefixes(on), _prefixes((starts - starts[0]) * on)
            under_way = spells[begun] - spells[over]
            awake += spells[over] * self._length + under_way * (asked - starts[0]) - (into[begun] - into[over])
            switches += spells[begun] + spells[over] if self._sleeps_within else _prefixes(on != before)[begun]
        return awake[1:] - awake[0], switches[1:] - switches[0]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A period so short that hardly a frame fits, or that a node has too many of them in a run."""
        lasts = setup.steps * setup.dt
        if lasts > MOST_PERIODS * self.period:
            yield Issue(
                ("sleep", "period"),
                f"a run of {lasts:g} s has {lasts / self.period:.3g} periods of {self.period:g} s; at most "
                f"{MOST_PERIODS:,} are allowed",
            )
        airtime = getattr(getattr(setup, "mac", None), "airtime", None)
        if airtime is None:
            return
        frame = airtime(setup.mac.bits(setup.mac.payload_bits))  # type: ignore[attr-defined]
        if self._length < 2.0 * frame:
            yield Issue(
                ("sleep", "period"),
                f"nodes would be awake for {1000 * self._length:.3g} ms at a time: not two of the longest frames "
                f"({1000 * frame:.3g} ms) fit",
            )

    def _start(self, phases: Floats, periods: Ints) -> Floats:
        """When periods begin: the one instant that everything here compares with."""
        starts: Floats = phases + (periods - 1) * self.period
        return starts

    def _number(self, phases: Floats, time: Floats | float) -> Ints:
        """The number of each node's period at a time: a quotient, set right where it was rounded over an instant."""
        periods = np.floor((time - phases) / self.period).astype(np.int64) + 1
        periods -= self._start(phases, periods) > time
        periods += self._start(phases, periods + 1) <= time
        return periods

    def _history(self, keys: Keys, since: Floats, until: Floats) -> Iterator[tuple[Ints, Floats, Bools, Bools]]:
        """Every period of every node that overlaps [since, until], node by node, in chunks.

        (nodes, when the period begins, whether the node is awake in it, whether it was in the one before), (M,) each.
        """
        phases = self._phases(keys)
        first = self._number(phases, since)
        owners, first, counts = _pieces(first, np.maximum(self._number(phases, until) - first + 1, 0))
        for chunk in _chunks(counts):
            begins = np.cumsum(counts[chunk]) - counts[chunk]
            nodes = np.repeat(owners[chunk], counts[chunk])
            periods = np.arange(nodes.size) + np.repeat(first[chunk] - begins, counts[chunk])
            on = self._on(keys[nodes], periods)
            before = np.concatenate((on[:1], on[:-1]))
            leading = begins[counts[chunk] > 0]
            before[leading] = self._on(keys[nodes[leading]], periods[leading] - 1)
            yield nodes, self._start(phases[nodes], periods), on, before

    def _in_order(self, keys: Keys, until: float) -> Iterator[tuple[Floats, Bools, Bools]]:
        """Every period of every node that begins before `until`, in the order in which they begin, in chunks.

        (when it begins, whether the node is awake in it, whether it was in the one before), (M,) each. Nodes follow
        one another by their phases, in each round of periods anew.
        """
        if not keys.size:
            return
        phases = self._phases(keys)
        order = np.argsort(phases)
        keys, phases = keys[order], phases[order]
        rounds, together = int(until // self.period) + 3, max(1, CHUNK // keys.size)
        last = self._on(keys, np.full((1, 1), -1))
        for begin in range(0, rounds, together):
            periods = np.arange(begin, min(begin + together, rounds))[:, None]
            on = np.concatenate((last, self._on(keys, periods)))
            last = on[-1:]
            yield self._start(phases, periods).ravel(), on[1:].ravel(), on[:-1].ravel()

    def _changes(self, nodes: Ints, starts: Floats, on: Bools, before: Bools) -> Iterator[tuple[Ints, Floats]]:
        """(nodes, times) at which nodes fall asleep or wake."""
        if self._sleeps_within:
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

    @property
    def _sleeps_within(self) -> bool:
        """Whether a node falls asleep before a period of being awake is over."""
        return self._length < self.period


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
        on: Bools = uniforms(derive_each(keys, (periods + 1).astype(np.uint64)), 0) < self.probability
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
        return np.ones(np.broadcast_shapes(keys.shape, periods.shape), dtype=np.bool_)

    @property
    def _length(self) -> float:
        return self.period * self.awake_share


def _prefixes(values: Floats | Bools) -> Floats:
    """(M + 1,) the sums of the first 0, 1, ... M of the values (M,)."""
    sums = np.zeros(values.size + 1)
    np.cumsum(values, out=sums[1:])
    return sums


def _pieces(first: Ints, counts: Ints) -> tuple[Ints, Ints, Ints]:
    """(owners, first, counts) of runs of numbers, cut where they are longer than a chunk."""
    owners = np.arange(counts.size)
    if counts.max(initial=0) <= CHUNK:
        return owners, first, counts
    pieces = -(-counts // CHUNK)
    owners = np.repeat(owners, pieces)
    skipped = CHUNK * (np.arange(owners.size) - np.repeat(np.cumsum(pieces) - pieces, pieces))
    return owners, first[owners] + skipped, np.minimum(counts[owners] - skipped, CHUNK)


def _chunks(counts: Ints) -> Iterator[slice]:
    """Slices of runs whose counts add up to no more than a chunk."""
    ends = np.cumsum(counts)
    begin = 0
    while begin < counts.size:
        done = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, done + CHUNK, side="right")), begin + 1)
        yield slice(begin, end)
        begin = end
