"""Who is awake: by its schedule of sleep, or held awake because it has something to do.

    rota.hears(ids, since) -> (n,)      rota.is_awake(node)      rota.note(node, mode)      rota.forgone()

Nothing is done when a node that follows its schedule wakes: its schedule is a function of time. What is kept is who is
*off* its schedule, held awake or down, what of its schedule it has left out by that, and what was last looked up.
"""

from __future__ import annotations

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.radio import Mode
from wsnsim.base.sleeping import SleepSchedule

Totals = tuple[float, float, float]


class DutyCycles:
    """The schedules of all nodes. `keys` (N,): a counter key each."""

    def __init__(self, env: simpy.Environment, schedule: SleepSchedule, keys: Keys) -> None:
        self._env = env
        self._schedule = schedule
        self._keys = keys
        self._held = np.zeros(keys.size, dtype=np.bool_)
        self._since = np.zeros(keys.size)
        self._awake = np.zeros(keys.size, dtype=np.bool_)
        self._from, self._until = np.zeros(keys.size), np.zeros(keys.size)
        self._off: dict[int, float] = {}
        self._forgone = (0.0, 0.0, 0.0)
        self._spans: list[tuple[int, float, float]] = []
        self._held_seconds = 0.0

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) who has been listening since an instant of the past: by schedule then, or held awake since before.

        A radio that is receiving when its schedule ends receives the frame to its end.
        """
        awake = self._by_schedule(ids, since)
        held: Bools = self._held[ids]
        return awake | (held & (self._since[ids] <= since)) if held.any() else awake

    def _by_schedule(self, ids: Ints, time: float) -> Bools:
        """(n,) whose schedule says that they are awake: looked up anew only where that may have changed."""
        known = (self._from[ids] <= time) & (time < self._until[ids])
        if not known.all():
            stale = ids[~known]
            found = self._schedule.state(self._keys[stale], time)
            self._awake[stale], self._from[stale], self._until[stale] = found
        awake: Bools = self._awake[ids]
        return awake

    def is_awake(self, node: int) -> bool:
        """Whether a living node is awake now."""
        return bool(self._held[node]) or self.scheduled(node) is Mode.AWAKE

    def scheduled(self, node: int) -> Mode:
        """What a node's schedule says now: AWAKE or ASLEEP."""
        return Mode.AWAKE if self._by_schedule(np.array([node]), self._env.now)[0] else Mode.ASLEEP

    def may_fall_asleep(self, node: int, within: float) -> bool:
        """Whether a node follows its schedule, and sleeps by it now, or may within so many seconds."""
        if node in self._off:
            return False
        return self.scheduled(node) is Mode.ASLEEP or self._until[node] <= self._env.now + within

    def next_change(self, node: int) -> float:
        """When the schedule of a node may next say otherwise."""
        self._by_schedule(np.array([node]), self._env.now)
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
        held = mode in (Mode.AWAKE, Mode.DORMANT)
        if held and not self._held[node]:
            self._since[node] = now
        self._held[node] = held

    def tally(self, nodes: Ints, since: Floats) -> tuple[Floats, Floats]:
        """(n,) seconds that nodes' schedules keep them awake from then until now, and how often they change."""
        return self._schedule.tally(self._keys[nodes], since, self._env.now)

    def tally_one(self, node: int, since: float) -> tuple[float, float]:
        """The same of one node: at once where nothing has changed since."""
        now = self._env.now
        if self._from[node] <= since and now < self._until[node]:
            return (now - since if self._awake[node] else 0.0), 0.0
        awake, switches = self.tally(np.array([node]), np.array([since]))
        return float(awake[0]), float(switches[0])

    def most_switches(self, until: float) -> float:
        """How often a node changes at most until then."""
        return float(self._schedule.tally(self._keys, np.zeros(self._keys.size), until)[1].max(initial=0.0))

    def profile(self, times: Floats) -> tuple[Floats, Floats]:
        """Of all nodes, if all followed their schedules: awake seconds until each time, and switches, both (T,)."""
        return self._schedule.profile(self._keys, times)

    def forgone(self) -> Totals:
        """What nodes off their schedules have left out of them until now: (awake seconds, switches, seconds in all)."""
        now = self._env.now
        self._forgone = _sum(self._forgone, self._left_out(self._spans))
        self._spans = []
        return _sum(self._forgone, self._left_out([(node, since, now) for node, since in self._off.items()]))

    def awake_fraction(self, until: float) -> float:
        """The share of all nodes' time from 0 to `until`, which is now, that they were awake."""
        held = sum(until - since for node, since in self._off.items() if self._held[node])
        scheduled = float(self.profile(np.array([until]))[0][0]) - self.forgone()[0]
        return (scheduled + self._held_seconds + held) / (self._keys.size * until) if until else 0.0

    def _left_out(self, spans: list[tuple[int, float, float]]) -> Totals:
        """What (node, since, until) spans hold of the nodes' schedules."""
        if not spans:
            return 0.0, 0.0, 0.0
        nodes, since, until = (np.array(column) for column in zip(*spans, strict=True))
        awake, switches = self._schedule.tally(self._keys[nodes], since, until)
        return float(awake.sum()), float(switches.sum()), float((until - since).sum())


def _sum(some: Totals, more: Totals) -> Totals:
    return some[0] + more[0], some[1] + more[1], some[2] + more[2]
