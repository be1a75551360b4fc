"""Where the nodes of a network stand, which are up, and which listen, by schedule or because they are held awake.

    sleep_states.hears(ids, since, living) -> (n,)      is_awake(node)      note(node, mode)      skipped()

No event happens when a node that follows its schedule wakes: a schedule is a function of time. Stored are the nodes
that are *off* their schedules (held awake, or down), and what the schedules last said.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints, scalars
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.radio import Mode
from wsnsim.kernels.nodes import listening
from wsnsim.network.energy.local_schedules import LocalSchedules

LINGER: Final = 1.0
"""A node that sends less than this time (s) before its schedule ends is held awake. Frames hardly ever wait longer."""
Totals: TypeAlias = tuple[float, float, float]
"""Awake seconds, switches between awake and asleep, and seconds in total."""


class SleepStates:
    """Which nodes are awake when. `rest` is the mode of one without a task: SCHEDULED if nodes follow `schedules`."""

    def __init__(
        self, rest: Mode = Mode.DORMANT, env: simpy.Environment | None = None, schedules: LocalSchedules | None = None
    ) -> None:  # fmt: skip
        self.rest = rest
        if schedules is None:
            assert rest is not Mode.SCHEDULED, "nodes that follow schedules have some"
            return
        assert env is not None, "schedules are followed in simulated time"
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
        if self.rest is not Mode.SCHEDULED:
            return np.asarray(living[ids])
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
        if self.rest is not Mode.SCHEDULED:
            return math.inf
        self.scheduled(node)
        return float(self._until[node])

    def note(self, node: int, mode: Mode) -> None:
        """A node leaves its schedule (held awake, or down), or follows it again."""
        if self.rest is not Mode.SCHEDULED:
            return
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
        if self.rest is not Mode.SCHEDULED:
            return True
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
        if self.rest is not Mode.SCHEDULED:
            return 0.0
        return self._schedules.most_switches(until)

    def profile(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """If all nodes with schedules followed them: awake seconds, switches and total seconds by each time, (T,)."""
        if self.rest is not Mode.SCHEDULED:
            nothing = np.zeros(times.size)
            return nothing, nothing, nothing
        awake, switches = self._schedules.profile(times)
        return awake, switches, self._size * times

    def skipped(self) -> Totals:
        """Scheduled awake time, switches and total time that did not happen because nodes were held awake or down."""
        if self.rest is not Mode.SCHEDULED:
            return 0.0, 0.0, 0.0
        now = self._env.now
        self._skipped = _sum(self._skipped, self._in_spans(self._spans))
        self._spans = []
        return _sum(self._skipped, self._in_spans([(node, since, now) for node, since in self._off.items()]))

    def awake_fraction(self, until: float) -> float:
        """Share of the time of all nodes from 0 to `until`, which is now, that they were awake. Down is asleep."""
        if self.rest is not Mode.SCHEDULED:
            return 1.0
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


class Places:
    """Positions of nodes: `positions` (N, 2) in m, single coordinates `x` and `y`, and a `grid` for neighbours."""

    def __init__(self, positions: Floats) -> None:
        self.positions = positions
        self.grid = CellGrid(positions)
        self.x, self.y = scalars(self.grid.x), scalars(self.grid.y)


class NodeStates:
    """The places and states of nodes. What they cost is in `nodes.Nodes`, which changes them.

    Attributes:
        positions: (N, 2) in m where the nodes stand; `x` and `y` give single coordinates, `grid` finds neighbours.
        assumed: The positions that filters, cluster heads, messages and greedy routing use; by default `positions`.
        traits: (N, T) constants of the sensors.
        reach: Communication range in m.
        living: (N,) which nodes are up, that is neither dead nor crashed; `alive[i]` is the same for single nodes.
        all_listen: Whether all nodes are up and listen.
        jammed, loss: (N,) radios that faults jam, and the probability that faults lose a frame from or to a node.
        disturbed: Whether any node is jammed or loses frames.
        sleep_states: The modes of nodes that do not rest, and the sleep schedules of those that do.
    """

    def __init__(self, positions: Floats, traits: Floats, reach: float, sleep_states: SleepStates) -> None:
        self.assumed = places = Places(positions)
        self.positions, self.x, self.y, self.grid = positions, places.x, places.y, places.grid
        self.traits = traits
        self.size = size = len(positions)
        self.reach = reach
        self.living = np.ones(size, dtype=np.bool_)
        self.alive = scalars(self.living)
        self.jammed, self.loss = np.zeros(size, dtype=np.bool_), np.zeros(size)
        self.disturbed = False
        self.sleep_states = sleep_states
        self.follows_schedules = sleep_states.rest is Mode.SCHEDULED
        self.all_listen = not self.follows_schedules
        self._always_awake: set[int] = set()
        self._up_since, self._last_restart = np.zeros(size), 0.0

    def distance(self, a: int, b: int) -> float:
        """Distance in m between two nodes."""
        dx, dy = self.x[a] - self.x[b], self.y[a] - self.y[b]
        return float((dx * dx + dy * dy) ** 0.5)

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which nodes are up and have been listening since a time that is not in the future."""
        hears = self.sleep_states.hears(ids, since, self.living)
        return hears if since >= self._last_restart else hears & (self._up_since[ids] <= since)

    def all_heard(self, since: float) -> bool:
        """Whether all nodes are up and have been listening since a time that is not in the future."""
        return self.all_listen and since >= self._last_restart

    def is_awake(self, node: int) -> bool:
        """Whether a node is up and listens now."""
        return self.alive[node] and (not self.follows_schedules or self.sleep_states.is_awake(node))

    def is_scheduled_awake(self, node: int) -> bool:
        """Whether a node has a schedule that says that it is awake now."""
        return self.follows_schedules and self.sleep_states.scheduled(node) is Mode.AWAKE

    def rest_of(self, node: int) -> Mode:
        """The mode of a node that has nothing to do."""
        return Mode.AWAKE if node in self._always_awake else self.sleep_states.rest

    def _mark_up(self, node: int, now: float) -> None:
        self._up_since[node] = self._last_restart = now
        self.living[node] = True
        self.all_listen = not self.follows_schedules and bool(self.living.all())

    def _mark_down(self, node: int) -> None:
        self.living[node] = False
        self.all_listen = False
