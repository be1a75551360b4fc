"""The background consumption of the whole network as a function of time, without a loop over nodes.

The power of the network is a sum over its nodes that changes when a node changes its state. What is booked elsewhere
(see `background_consumption`) is subtracted as it happens. The consumption of nodes that follow sleep schedules is left
out: `scheduled` computes it for many times at once, as if no node ever left its schedule; `until` corrects for those
that did.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, scalars
from wsnsim.base.radio import Mode
from wsnsim.base.tables import CAUSES
from wsnsim.network.energy.ledger import Charges
from wsnsim.network.energy.power_table import AWAKE, IDLE, MODES, ON, SENSE, SLEEP, SWITCH, PowerTable
from wsnsim.network.node_states import SleepStates

OVER_TIME: Final = (IDLE, SLEEP, SENSE, SWITCH)
"""Causes on which background consumption is booked."""


class NetworkTotals:
    """The totals of a network whose nodes are all in the mode `rest` of their sleep states at time 0.

    Attributes:
        array: (causes + 1,) joules to add to power times time, by cause; seconds for ON. `joules[cause]` is the same.
    """

    def __init__(self, table: PowerTable, sleep_states: SleepStates, size: int, per_switch: float) -> None:
        """Begin at time 0.

        Args:
            table: The power of a node in each state.
            sleep_states: Which nodes are awake.
            size: Number of nodes.
            per_switch: Joules of a switch between awake and asleep, mean of both.
        """
        self._table = table
        self._sleep_states = sleep_states
        self._size = size
        self._per_switch = per_switch
        self.array = np.zeros(ON + 1)
        self.joules = scalars(self.array)
        self._power: dict[int, float] = dict.fromkeys((*OVER_TIME, ON), 0.0)
        self._booked: dict[int, float] = {SENSE: 0.0, SWITCH: 0.0}
        if sleep_states.rest is not Mode.SCHEDULED:
            for cause, power in table.powers(int(sleep_states.rest)):
                self._power[cause] += size * power

    def note_booked(self, charges: Charges) -> None:
        """Note charges that nodes have booked and that are part of these totals."""
        for cause, joules in charges:
            if cause in self._booked:
                self._booked[cause] += joules

    def correct(self, cause: int, joules: float) -> None:
        """Add to the total of a cause: a node that died could not pay what it consumed, or lost its remainder."""
        if cause not in self._booked:
            self.joules[cause] += joules

    def change_state(self, before: int, after: int, busy: float, computed: float, now: float) -> None:
        """A node changes its state.

        Args:
            before: The state until now.
            after: The state from now on.
            busy: Seconds from now on in which its radio is booked elsewhere.
            computed: Seconds from now on in which its processor is booked elsewhere.
            now: The time in s.
        """
        table, total = self._table, self.joules
        for state, sign in ((before, -1.0), (after, 1.0)):
            total[table.radio_cause[state]] -= sign * table.radio[state] * busy
            total[ON] += sign * table.off[state] * busy
            total[table.processor_cause[state]] -= sign * table.processor[state] * computed
            if not table.scheduled[state]:
                for cause, power in table.powers(state):
                    self._power[cause] += sign * power
                    total[cause] -= sign * power * now

    def until(self, now: float, settled: Sequence[float], awake_at: Iterable[float]) -> list[float]:
        """Joules by cause until now, without `scheduled`.

        Args:
            now: The time in s.
            settled: Joules by cause that nodes have booked.
            awake_at: Seconds for which nodes with schedules were awake at each level of their radios.
        """
        result = list(settled)
        for cause in OVER_TIME:
            booked = settled[cause] - self._booked[cause] if cause in self._booked else 0.0
            result[cause] = booked + self.joules[cause] + self._power[cause] * now
        # what `scheduled` will count for times in which nodes did not follow their schedules
        awake, switches, passed = self._sleep_states.skipped()
        for cause, joules in self._table.by_schedule(awake, passed, self._per_switch * switches):
            result[cause] -= joules
        # `scheduled` takes all radios at level 0: replace that by the level they were at
        for level, seconds in enumerate(awake_at):
            for sign, each in ((1.0, level), (-1.0, 0)):
                for cause, joules in self._table.by_schedule(seconds, seconds, 0.0, level=each):
                    result[cause] += sign * joules
        return result

    def radio_on(self, now: float, awake_at: Iterable[float]) -> float:
        """Share of the time of all nodes until now in which radios were on; `awake_at` as in `until`."""
        on = self._table.on
        scheduled = float(self._sleep_states.profile(np.array([now]))[0][0]) - self._sleep_states.skipped()[0]
        seconds = self.joules[ON] + self._power[ON] * now + on[AWAKE] * scheduled
        for level, awake in enumerate(awake_at):
            seconds += (on[level * MODES + AWAKE] - on[AWAKE]) * awake
        return float(seconds / (self._size * now)) if now else 0.0

    def scheduled(self, times: Floats) -> Floats:
        """(T, causes) joules of all nodes until each time, as if they had always followed their schedules."""
        totals = np.zeros((times.size, len(CAUSES)))
        awake, switches, passed = self._sleep_states.profile(times)
        for cause, joules in self._table.by_schedule(awake, passed, self._per_switch * switches):
            totals[:, cause] += joules
        return totals
