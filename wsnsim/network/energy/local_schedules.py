"""What the sleep schedules of nodes say at true times: they go by the clocks of the nodes.

    schedules.state(nodes, time)    schedules.tally(nodes, since (n,), until) -> seconds awake, changes

A clock is a linear function of true time between two changes (steps and corrections). Between them the awake time of a
node is its schedule's closed form over local time, divided by the rate of the clock. Where clocks are perfect, the
schedules are asked with true times.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.sleeping import SleepSchedule
from wsnsim.network.clocks import Clocks


class LocalSchedules:
    """The schedules of nodes with the counter keys `keys` (N,), by their clocks. A change of a clock is noted."""

    def __init__(self, schedule: SleepSchedule, keys: Keys, clocks: Clocks) -> None:
        self._schedule = schedule
        self._keys = keys
        self._clocks = clocks
        self.size = keys.size
        self._first = clocks.error_lines(np.arange(keys.size))
        """The errors of clocks as they were at the start, b + m t: b (N,) and m (N,)."""
        self._changed_at = np.full(self.size, -np.inf)
        """(N,) when clocks changed last."""
        self._changes: dict[int, list[float]] = {}
        self._lines: dict[int, list[tuple[float, float]]] = {}
        """By node whose clock has changed: the times of changes, and (b, m) before the first and after each of them."""

    def note_change(self, node: int, now: float) -> None:
        """The clock of a node was stepped or corrected just now."""
        (base,), (slope,) = self._clocks.error_lines(np.array([node]))
        if node not in self._changes:
            bases, slopes = self._first
            self._changes[node], self._lines[node] = [], [(float(bases[node]), float(slopes[node]))]
        if self._changed_at[node] == now:
            self._lines[node][-1] = float(base), float(slope)
            return
        self._changed_at[node] = now
        self._changes[node].append(now)
        self._lines[node].append((float(base), float(slope)))

    def state(self, nodes: Ints, time: float) -> tuple[Bools, Floats, Floats]:
        """Which nodes are awake at a time (n,), and spans [from (n,), until (n,)) around it without a change.

        The time may lie before a change of a clock: it is judged by the clock as it was then.
        """
        if self._clocks.perfect:
            return self._schedule.state(self._keys[nodes], time)
        bases, slopes = self._clocks.error_lines(nodes)
        begins, ends = self._changed_at[nodes], np.full(nodes.size, np.inf)
        for place in np.flatnonzero(begins > time).tolist():
            node = int(nodes[place])
            times, index = self._changes[node], bisect_right(self._changes[node], time)
            bases[place], slopes[place] = self._lines[node][index]
            begins[place], ends[place] = (times[index - 1] if index else -np.inf), times[index]
        awake, since, until = self._schedule.state(self._keys[nodes], time + (bases + slopes * time))
        since, until = (since - bases) / (1.0 + slopes), (until - bases) / (1.0 + slopes)
        # Rounding must not put the time outside its span, or it would be asked about for ever.
        until = np.maximum(until, np.nextafter(time, np.inf))
        return awake, np.maximum(np.minimum(since, time), begins), np.minimum(until, ends)

    def tally(self, nodes: Ints, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """(n,) true seconds that schedules keep nodes awake in [since, until), and (n,) switches in (since, until].

        The step of a clock is a switch, too, if it takes a node from a time awake to one asleep, or back; one at
        `since` counts, and one at `until` does not.
        """
        if self._clocks.perfect:
            return self._schedule.tally(self._keys[nodes], since, until)
        until = np.full(nodes.size, until)
        seconds, switches = self._on_lines(self._keys[nodes], since, until, *self._clocks.error_lines(nodes))
        for place in np.flatnonzero(self._changed_at[nodes] >= since).tolist():
            spells = self._spells(int(nodes[place]), np.array([since[place], until[place]]))
            seconds[place], switches[place] = spells[0][-1], spells[1][-1]
        return seconds, switches

    def profile(self, times: Floats) -> tuple[Floats, Floats]:
        """Awake seconds (T,) and switches (T,) of all nodes together, from 0 to each of the ascending times (T,)."""
        if self._clocks.perfect:
            return self._schedule.profile(self._keys, times)
        steady = np.setdiff1d(np.arange(self.size), np.fromiter(self._changes, np.int64, len(self._changes)))
        cuts = np.append(0.0, times)
        pieces = np.zeros((2, times.size))
        for index in range(times.size) if steady.size else ():
            pieces[:, index] = [
                each.sum() for each in self.tally(steady, np.full(steady.size, cuts[index]), cuts[index + 1])
            ]
        totals = pieces.cumsum(axis=1)
        for node in self._changes:
            totals += self._spells(node, cuts)[:, 1:]
        return totals[0], totals[1]

    def most_switches(self, until: float) -> float:
        """The largest number of switches of a node from 0 to `until`.

        For clocks that are not perfect, twice what the schedules say of a time that is longer by the largest error: for
        time that is lived twice after a step back, and the steps themselves.
        """
        start = np.zeros(self.size)
        if self._clocks.perfect:
            return float(self._schedule.tally(self._keys, start, until)[1].max(initial=0.0))
        error = self._clocks.largest_error(until)
        return 2.0 * float(self._schedule.tally(self._keys, start - error, until + error)[1].max(initial=0.0))

    def _spells(self, node: int, cuts: Floats) -> Floats:
        """(2, C) seconds awake and switches of a node from the first of the ascending cuts (C,) until each of them."""
        times, lines = self._changes[node], np.array(self._lines[node])
        first, last = bisect_left(times, cuts[0]), bisect_left(times, cuts[-1])
        within = np.array(times[first:last])
        marks = np.concatenate([cuts, within])
        marks.sort(kind="stable")
        since, until = marks[:-1], marks[1:]
        bases, slopes = lines[np.searchsorted(times, since, side="right")].T
        seconds, switches = self._on_lines(np.repeat(self._keys[node], since.size), since, until, bases, slopes)
        switches[np.searchsorted(marks, within, side="right") - 1] += self._jumps(node, within, lines[first : last + 1])
        spells = np.zeros((2, marks.size))
        np.cumsum([seconds, switches], axis=1, out=spells[:, 1:])
        return spells[:, np.searchsorted(marks, cuts)]

    def _on_lines(
        self, keys: Keys, since: Floats, until: Floats, bases: Floats, slopes: Floats
    ) -> tuple[Floats, Floats]:
        """(n,) true seconds awake in [since, until) and (n,) switches, while the errors of clocks are b + m t."""
        begins, ends = since + (bases + slopes * since), until + (bases + slopes * until)
        seconds, switches = self._schedule.tally(keys, begins, ends)
        return np.minimum(seconds / (1.0 + slopes), until - since), switches

    def _jumps(self, node: int, times: Floats, lines: Floats) -> Bools:
        """(M,) whether the change of a clock at a time (M,), from one line (M + 1, 2) to the next, is a switch."""
        keys, (bases, slopes) = np.repeat(self._keys[node], times.size), lines.T
        before = self._schedule.awake(keys, times + (bases[:-1] + slopes[:-1] * times))
        after = self._schedule.awake(keys, times + (bases[1:] + slopes[1:] * times))
        switches: Bools = before != after
        return switches
