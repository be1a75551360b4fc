"""Sleep schedules: when nodes sense and listen, as a function of time and of one random key per node.

    awake(keys (n,), time) -> (n,)    tally(keys, since (n,), until) -> seconds awake, switches    profile(keys, times)

Nothing is stored and nothing is polled: the awake time of a node over any span is computed on request. Times in s, from
0 on.
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
from wsnsim.kernels.nodes import Law, period_spans, period_sums
from wsnsim.models.bounds import PROBABILITY, SHARE

PERIOD: Final = Quantity("s", ge=1e-2, le=1e9)
MOST_PERIODS: Final = 10_000_000
"""Greatest number of periods of a node in a run: each is evaluated when its past is summed."""
CHUNK: Final = 1 << 16
"""(node, period) pairs that are evaluated together: 0.5 MB per column, which fits the processor's cache."""


class _NeverAsleep:
    """The base of schedules that never let the radio sleep."""

    always_listening: ClassVar[bool] = True

    def awake(self, keys: Keys, time: Floats | float) -> Bools:
        """(n,) True: every node is awake."""
        return np.ones(len(keys), dtype=np.bool_)

    def state(self, keys: Keys, time: Floats | float) -> tuple[Bools, Floats, Floats]:
        """Every node is awake, for all time."""
        return np.ones(len(keys), dtype=np.bool_), np.zeros(len(keys)), np.full(len(keys), math.inf)

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """(n,) seconds awake: the whole span; and (n,) switches between awake and asleep: 0."""
        return until - np.asarray(since, dtype=np.float64), np.zeros(len(keys))

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """(T,) seconds awake of all nodes together until each time, and (T,) switches: 0."""
        return len(keys) * times, np.zeros(times.size)


@part
class EventWake(_NeverAsleep):
    """Dormant nodes keep sensor and receiver on; a target or a frame wakes them (Jiang, Song, Lin 2013, 2.3)."""

    rest: ClassVar[Mode] = Mode.DORMANT


@part
class AlwaysOn(_NeverAsleep):
    """Nodes never sleep: receiver and processor stay on. The reference for other schedules."""

    rest: ClassVar[Mode] = Mode.AWAKE


class _PeriodicSchedule:
    """A schedule in periods: node k begins one at each phase_k + j T, and is awake in its first part or not at all.

    Phases are uniform on [0, T), or 0 for all nodes. A subclass gives the `_law` of `kernels.nodes`: T, the awake
    part in s, the probability of being awake in a period, and whether nodes have phases of their own.
    """

    always_listening: ClassVar[bool] = False
    rest: ClassVar[Mode] = Mode.SCHEDULED
    period: float

    def awake(self, keys: Keys, time: Floats | float) -> Bools:
        """(n,) which nodes are awake at a time, or each at a time of its own (n,)."""
        return self.state(keys, time)[0]

    def state(self, keys: Keys, time: Floats | float) -> tuple[Bools, Floats, Floats]:
        """Which nodes are awake (n,), and the part of a period that contains the time: from (n,), until (n,)."""
        awake, begins, ends = np.empty(keys.size, dtype=np.bool_), np.empty(keys.size), np.empty(keys.size)
        # an integer time would make Numba compile a second version
        times = np.full(keys.size, time, dtype=np.float64)
        period_spans(keys, times, self._law, awake, begins, ends)
        return awake, begins, ends

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """(n,) seconds awake in [since, until), and switches between awake and asleep in (since, until]."""
        seconds, switches, ends = np.empty(keys.size), np.empty(keys.size), np.empty(keys.size)
        ends[:] = until
        period_sums(keys, np.asarray(since, dtype=np.float64), ends, self._law, seconds, switches)
        return seconds, switches

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Awake seconds and switches (T,) of all nodes together until each of the ascending times (T,).

        Periods are evaluated in the order in which they begin, so that running sums need no sorting: the cost is one
        hash per node and period, whatever T. An awake spell that has ended counts in full, one under way from its
        beginning. In a chunk times are relative to its first, so that sums stay small and exact. Periods begin before
        time 0: what they add until then is subtracted at the end.
        """
        asked = np.append(0.0, times)
        awake, switches = np.zeros(asked.size), np.zeros(asked.size)
        for starts, on, before in self._in_order(keys, float(asked[-1])):
            begun = np.searchsorted(starts, asked, side="right")
            ended = np.searchsorted(starts + self.awake_part, asked, side="right")
            spells, start_sums = _prefixes(on), _prefixes((starts - starts[0]) * on)
            under_way = spells[begun] - spells[ended]
            since_first, begun_after = under_way * (asked - starts[0]), start_sums[begun] - start_sums[ended]
            awake += spells[ended] * self.awake_part + since_first - begun_after
            # a node that is awake for whole periods switches only if the period before was different
            switches += (
                spells[begun] + spells[ended] if self.awake_part < self.period else _prefixes(on != before)[begun]
            )
        return awake[1:] - awake[0], switches[1:] - switches[0]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if a node has too many periods in a run, or if an awake part is too short for two frames."""
        duration = setup.duration
        if duration > MOST_PERIODS * self.period:
            yield Issue(
                ("sleep", "period"),
                f"a run of {duration:g} s has {duration / self.period:.3g} periods of {self.period:g} s; at most "
                f"{MOST_PERIODS:,} are allowed",
            )
        airtime = getattr(getattr(setup, "mac", None), "airtime", None)
        if airtime is None:
            return
        frame = airtime(setup.mac.bits(setup.mac.payload_bits))  # type: ignore[attr-defined]
        if self.awake_part < 2.0 * frame:
            yield Issue(
                ("sleep", "period"),
                f"nodes would be awake for {1000 * self.awake_part:.3g} ms at a time, which is too short for two of "
                f"the longest frames ({1000 * frame:.3g} ms)",
            )

    def _in_order(self, keys: Keys, until: float) -> Iterator[tuple[Floats, Bools, Bools]]:
        """The periods of all nodes that begin before `until`, in the order in which they begin, in chunks.

        Each chunk is (beginnings, awake in the period, awake in the period before), (M,) each. In each round every
        node begins one period, in the order of the phases.
        """
        if not keys.size:
            return
        phases = self._phases(keys)
        order = np.argsort(phases)
        keys, phases = keys[order], phases[order]
        rounds, rounds_per_chunk = int(until // self.period) + 3, max(1, CHUNK // keys.size)
        previous = self._on(keys, np.full((1, 1), -1))
        for begin in range(0, rounds, rounds_per_chunk):
            periods = np.arange(begin, min(begin + rounds_per_chunk, rounds))[:, None]
            on = np.concatenate((previous, self._on(keys, periods)))
            previous = on[-1:]
            yield (phases + (periods - 1) * self.period).ravel(), on[1:].ravel(), on[:-1].ravel()

    def _phases(self, keys: Keys) -> Floats:
        period, _, _, staggered = self._law
        return period * uniforms(keys, 0) if staggered else np.zeros(len(keys))

    def _on(self, keys: Keys, periods: Ints) -> Bools:
        """Whether nodes are awake in their periods, of which number 0 contains time 0."""
        return uniforms(derive_each(keys, (periods + 1).astype(np.uint64)), 0) < self._law[2]

    @property
    def _law(self) -> Law:
        raise NotImplementedError

    @property
    def long_run(self) -> tuple[float, float]:
        """The share of the time in which a node is awake, and its switches per second."""
        period, awake_part, probability, _ = self._law
        changes = probability if awake_part < period else probability * (1.0 - probability)
        return probability * awake_part / period, 2.0 * changes / period

    @property
    def shortest_sleep(self) -> float:
        """The shortest time (s) for which a node sleeps: a whole period if it is awake for whole periods."""
        return self.period - self.awake_part or self.period

    @property
    def awake_part(self) -> float:
        """The shortest time (s) for which a node is awake."""
        return self._law[1]


@part
class RandomIndependent(_PeriodicSchedule):
    """Random independent sleeping: in each of its own periods a node is awake with a given probability.

    The nodes' phases are uniform over a period. Decisions are independent of other nodes and of the past.

    Source: Kumar, Lai, Balogh (2004); p and T are our choice, as Li, Jiang, Zhang, Zhang (2012) give none.
    """

    period: Annotated[float, PERIOD, "T_RIS: length of the periods, for each of which a node decides once"] = 10.0
    probability: Annotated[float, PROBABILITY, "p: probability of being awake in a period"] = 0.3

    @property
    def _law(self) -> Law:
        return self.period, self.period, self.probability, True


@part
class DutyCycle(_PeriodicSchedule):
    """Each node is awake in the first part of each period: all at the same time, or staggered at random.

    Our choice, for comparison: at an equal share of time awake it matters which nodes are awake together.
    """

    period: Annotated[float, PERIOD, "time from one waking to the next"] = 10.0
    awake_share: Annotated[float, SHARE, "share of the period that a node is awake"] = 0.3
    phases: Annotated[Literal["synchronous", "staggered"], "whether all nodes wake at the same time"] = "staggered"

    @property
    def _law(self) -> Law:
        return self.period, self.period * self.awake_share, 1.0, self.phases == "staggered"


def _prefixes(values: Floats | Bools) -> Floats:
    """(M + 1,) the sums of the first 0, 1, ..., M values of (M,)."""
    sums = np.zeros(values.size + 1)
    np.cumsum(values, out=sums[1:])
    return sums
