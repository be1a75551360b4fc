"""Sleep states: which nodes are awake, by their sleep schedule or because they are held awake.

    sleep_states.hears(ids, since, living) -> (n,)      is_awake(node)      note(node, mode)      skipped()

No event happens when a node that follows its schedule wakes: a schedule is a function of time. Stored are the nodes
that are *off* their schedules (held awake, or down), and what the schedules last said.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.radio import Mode
from wsnsim.kernels.nodes import listening
from wsnsim.network.energy.local_schedules import LocalSchedules

LINGER: Final = 1.0
"""A node that sends less than this time (s) before its schedule ends is held awake. Frames hardly ever wait longer."""
Totals: TypeAlias = tuple[float, float, float]
"""Awake seconds, switches between awake and asleep, and seconds in total."""


class SleepStates:
    """Which nodes are awake when: here those of nodes that always listen. `rest` is the mode of one without a task."""

    def __init__(self, rest: Mode = Mode.DORMANT) -> None:
        self.rest = rest

    def hears(self, ids: Ints, since: float, living: Bools) -> Bools:
        """(n,) which of the nodes are living (N,) and have been listening since a time that is not in the future."""
        found: Bools = living[ids]
        return found

    def is_awake(self, node: int) -> bool:
        """Whether a living node is awake now."""
        return True

    def scheduled(self, node: int) -> Mode:
        """What the schedule of a node says now: AWAKE or ASLEEP."""
        return Mode.AWAKE

    def next_change(self, node: int) -> float:
        """The earliest time at which the schedule of a node may say otherwise."""
        return math.inf

    def note(self, node: int, mode: Mode) -> None:
        """A node has changed to a mode."""

    def note_clock(self, node: int) -> None:
        """The clock of a node has been stepped or corrected."""

    def may_change(self, node: int, mode: Mode) -> bool:
        """A node has a task that needs this mode, or none; whether it may change now: not while it sends."""
        return True

    def begin_sending(self, node: int) -> bool:
        """A node has a frame to send; whether it must now be held awake for that."""
        return False

    def end_sending(self, node: int) -> bool:
        """A node has nothing more to send; whether it was held awake only for that."""
        return False

    def tally(self, nodes: Ints, since: Floats, until: float) -> tuple[Floats, Floats]:
        """(n,) seconds that schedules keep nodes awake in [since, until), and (n,) switches in that time."""
        return until - since, np.zeros(nodes.size)

    def tally_one(self, node: int, since: float, until: float) -> tuple[float, float]:
        """`tally` for one node."""
        return until - since, 0.0

    def most_switches(self, until: float) -> float:
        """The largest number of switches of a node from 0 to `until`."""
        return 0.0

    def profile(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """If all nodes with schedules followed them: awake seconds, switches and total seconds by each time, (T,)."""
        nothing = np.zeros(times.size)
        return nothing, nothing, nothing

    def skipped(self) -> Totals:
        """Scheduled awake time, switches and total time that did not happen because nodes were held awake or down."""
        return 0.0, 0.0, 0.0

    def awake_fraction(self, until: float) -> float:
        """Share of the time of all nodes from 0 to `until`, which is now, that they were awake. Down is asleep."""
        return 1.0


class ScheduledSleepStates(SleepStates):
    """The sleep states of nodes that follow a sleep schedule."""

    def __init__(self, env: simpy.Environment, schedules: LocalSchedules) -> None:
        super().__init__(Mode.SCHEDULED)
        self._env = env
        self._schedules = schedules
        self._size = size = schedules.size
        self._held = np.zeros(size, dtype=np.bool_)
        self._since = np.zeros(size)
        self._awake = np.zeros(size, dtype=np.bool_)
        self._from, self._until = np.zeros(size), np.zeros(size)
        self._off: dict[int, float] = {}
        self._skipped = (0.0, 0.0, 0.0)
        self._spans: list[tuple[int, float, float]] = []
        self._held_seconds = 0.0
        self._with_task: set[int] = set()
        self._sending: set[int] = set()

    def hears(self, ids: Ints, since: float, living: Bools) -> Bools:
        """(n,) which nodes are living (N,), and were awake by schedule then or have been held awake since before.

        A radio that is receiving when its schedule ends receives the frame to its end.
        """
        hears = np.empty(ids.size, dtype=np.bool_)
        time = float(since)  # an integer time would make Numba compile a second version
        schedules = (living, self._awake, self._from, self._until, self._held, self._since, hears)
        if listening(ids, time, *schedules):
            self._ask(ids, time)
            listening(ids, time, *schedules)
        return hears

    def _ask(self, ids: Ints, time: float) -> None:
        """Ask the schedules of nodes (n,) what they say at a time, unless what they last said is about it."""
        stale = ids[~((self._from[ids] <= time) & (time < self._until[ids]))]
        self._awake[stale], self._from[stale], self._until[stale] = self._schedules.state(stale, time)

    def is_awake(self, node: int) -> bool:
        """Whether a living node is awake now."""
        return bool(self._held[node]) or self.scheduled(node) is Mode.AWAKE

    def scheduled(self, node: int) -> Mode:
        """What the schedule of a node says now: AWAKE or ASLEEP."""
        if not self._from[node] <= self._env.now < self._until[node]:
            self._ask(np.array([node]), self._env.now)
        return Mode.AWAKE if self._awake[node] else Mode.ASLEEP

    def next_change(self, node: int) -> float:
        """The earliest time at which the schedule of a node may say otherwise."""
        self.scheduled(node)
        return float(self._until[node])

    def note(self, node: int, mode: Mode) -> None:
        """A node leaves its schedule (held awake, or down), or follows it again."""
        now = self._env.now
        if node in self._off:
            since = self._off.pop(node)
            self._spans.append((node, since, now))
            if self._held[node]:
                self._held_seconds += now - since
        if mode is not Mode.SCHEDULED:
            self._off[node] = now
        if mode is Mode.DOWN:
            self._with_task.discard(node)
            self._sending.discard(node)
        held = mode in (Mode.AWAKE, Mode.DORMANT)
        if held and not self._held[node]:
            self._since[node] = now
        self._held[node] = held

    def note_clock(self, node: int) -> None:
        """The clock of a node has been stepped or corrected: what its schedule last said is void."""
        self._schedules.note_change(node, self._env.now)
        self._from[node] = self._until[node] = 0.0

    def may_change(self, node: int, mode: Mode) -> bool:
        """A node has a task that needs this mode, or none; whether it may change now: not while it sends."""
        (self._with_task.discard if mode is Mode.SCHEDULED else self._with_task.add)(node)
        return node not in self._sending

    def begin_sending(self, node: int) -> bool:
        """Whether a node must be held awake to send: its schedule may end before the frame is sent."""
        if node in self._sending:
            return False
        if node in self._with_task:
            self._sending.add(node)
        elif self._may_fall_asleep(node):
            self._sending.add(node)
            return True
        return False

    def end_sending(self, node: int) -> bool:
        """Whether a node is no longer held awake: it was held only to send."""
        if node not in self._sending:
            return False
        self._sending.discard(node)
        return node not in self._with_task

    def _may_fall_asleep(self, node: int) -> bool:
        """Whether a node follows its schedule, and sleeps now or may do so soon."""
        if node in self._off:
            return False
        return self.scheduled(node) is Mode.ASLEEP or bool(self._until[node] <= self._env.now + LINGER)

    def tally(self, nodes: Ints, since: Floats, until: float) -> tuple[Floats, Floats]:
        """(n,) seconds that schedules keep nodes awake in [since, until), and (n,) switches in that time."""
        return self._schedules.tally(nodes, since, until)

    def tally_one(self, node: int, since: float, until: float) -> tuple[float, float]:
        """`tally` for one node; quick if its schedule has not changed since."""
        if self._from[node] <= since and until < self._until[node]:
            return (until - since if self._awake[node] else 0.0), 0.0
        awake, switches = self.tally(np.array([node]), np.array([since]), until)
        return float(awake[0]), float(switches[0])

    def most_switches(self, until: float) -> float:
        """The largest number of switches of a node from 0 to `until`."""
        return self._schedules.most_switches(until)

    def profile(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """If all nodes followed their schedules: awake seconds, switches and total seconds by each time, (T,)."""
        awake, switches = self._schedules.profile(times)
        return awake, switches, self._size * times

    def skipped(self) -> Totals:
        """Scheduled awake time, switches and total time that did not happen because nodes were held awake or down."""
        now = self._env.now
        self._skipped = _sum(self._skipped, self._in_spans(self._spans))
        self._spans = []
        return _sum(self._skipped, self._in_spans([(node, since, now) for node, since in self._off.items()]))

    def awake_fraction(self, until: float) -> float:
        """Share of the time of all nodes from 0 to `until`, which is now, that they were awake. Down is asleep."""
        held = sum(until - since for node, since in self._off.items() if self._held[node])
        scheduled = float(self.profile(np.array([until]))[0][0]) - self.skipped()[0]
        return (scheduled + self._held_seconds + held) / (self._size * until) if until else 0.0

    def _in_spans(self, spans: list[tuple[int, float, float]]) -> Totals:
        """What the schedules say of (node, since, until) spans."""
        if not spans:
            return 0.0, 0.0, 0.0
        nodes, since, until = (np.array(column) for column in zip(*spans, strict=True))
        awake, switches = self._schedules.tally(nodes, since, until)
        return float(awake.sum()), float(switches.sum()), float((until - since).sum())


def _sum(some: Totals, more: Totals) -> Totals:
    return some[0] + more[0], some[1] + more[1], some[2] + more[2]
