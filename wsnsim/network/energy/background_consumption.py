"""Background consumption: idle listening, sleep, and measurements that look for targets.

No event happens until a node spends energy or is asked for it: then it is *settled*, which means that its consumption
since the last time is computed and booked. The consumption is a function of the mode of the node, less the seconds in
which its radio or its processor was busy. The totals of the network need no look at the nodes: their power is a sum
that changes when a node changes its mode. A node that may run out before the end has a battery timer.

The consumption of a node that follows a sleep schedule is a closed form of the schedule. The network's totals leave
it out, as if no node ever left its schedule: `scheduled_totals` computes it for many times at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, TypeVar

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.kernels.charging import mark_busy
from wsnsim.network.energy.battery_timers import EVERYBODY, BatteryTimers
from wsnsim.network.energy.consumption import Consumption
from wsnsim.network.energy.duty_cycles import DutyCycles
from wsnsim.network.energy.ledger import Charges

IDLE, SLEEP, SENSE, SWITCH = CAUSE["idle"], CAUSE["sleep"], CAUSE["sense"], CAUSE["switch"]
OVER_TIME: Final = (IDLE, SLEEP, SENSE, SWITCH)
"""Causes on which background consumption is booked."""
AWAKE, ASLEEP, SCHEDULED = int(Mode.AWAKE), int(Mode.ASLEEP), int(Mode.SCHEDULED)
NEAR: Final = 1e-2
"""If the predicted lifetime (s) is below this, check at the predicted depletion time; otherwise after half of it."""
SOON: Final = 1e-9
"""A charge that lasts for less than this time (s) is what rounding leaves: the battery is empty."""
SHORTEST: Final = 5e-3
"""Mean time (s) between changes of the fastest schedule: two in its period of 10 ms."""
Number = TypeVar("Number", float, Floats)


class BackgroundConsumption(Consumption):
    """The background consumption of all nodes.

    Attributes:
        most: Joules that one node can consume at most in the whole run.
        timers: The battery timers.
    """

    def __init__(
        self,
        env: simpy.Environment,
        model: ContinuousPower,
        duty_cycles: DutyCycles,
        size: int,
        horizon: float,
        searching: float = 0.0,
        standby: float = 0.0,
    ) -> None:
        """Begin at time 0.

        Args:
            env: The clock.
            model: The energy model.
            duty_cycles: Which nodes are awake; all are in its mode `rest`.
            size: Number of nodes.
            horizon: End of the run in s.
            searching: Power in W that a node which is awake spends on measurements, to find targets.
            standby: Power in W of the wake-up receiver of a node that sleeps.
        """
        self._env = env
        self._model = model
        self._duty_cycles = duty_cycles
        self._size = size
        self._horizon = horizon
        rest = duty_cycles.rest
        table = [model.mode_power(Mode.AWAKE if mode is Mode.SCHEDULED else mode) for mode in Mode]
        self._radio = [float(power.radio) for power in table]
        self._radio[ASLEEP] += standby
        self._processor = [float(power.processor) for power in table]
        self._sensor = [searching if mode in (Mode.AWAKE, Mode.SCHEDULED) else 0.0 for mode in Mode]
        self._radio_cause = [SLEEP if power.radio_sleeps else IDLE for power in table]
        self._processor_cause = [SLEEP if power.processor_sleeps else IDLE for power in table]
        self._per_switch = (model.switching(Mode.AWAKE, Mode.ASLEEP) + model.switching(Mode.ASLEEP, Mode.AWAKE)) / 2.0
        self._modes = np.full(size, int(rest), dtype=np.int8)
        self._settled_at, self._radio_busy, self._computed = (np.zeros(size) for _ in range(3))
        self._counts = np.zeros(len(Mode), dtype=np.int64)
        self._mode, self._since = scalars(self._modes), scalars(self._settled_at)
        self._radio_busy_of, self._computed_of = scalars(self._radio_busy), scalars(self._computed)
        self._radio_law = np.array(self._radio), np.array(self._radio_cause, dtype=np.int64)
        self._grand_totals = np.zeros(len(CAUSES))
        self._grand = scalars(self._grand_totals)
        self._power: dict[int, float] = dict.fromkeys(OVER_TIME, 0.0)
        self._booked: dict[int, float] = {SENSE: 0.0, SWITCH: 0.0}
        if rest is not Mode.SCHEDULED:
            for cause, power in self._powers(int(rest)):
                self._power[cause] += size * power
        self.most = max(map(sum, zip(self._radio, self._processor, self._sensor, strict=True))) * horizon
        self._most_by_schedule = max(map(self._power_of_mode, (AWAKE, ASLEEP))) + self._per_switch / SHORTEST
        self._changes = 4.0 * self._per_switch  # half of it pays two changes that come at once, however slow
        if self._per_switch:
            self.most += duty_cycles.most_switches(horizon) * self._per_switch

    def start(self, battery: float, check: Callable[[int], None]) -> None:
        """Begin to watch batteries of a charge; `check(node)` is called when a node may have run out."""
        self.timers = BatteryTimers(self._env, check)
        rest = self._duty_cycles.rest
        resting = 2.0 * self._most_by_schedule if rest is Mode.SCHEDULED else self._power_of_mode(int(rest))
        if resting > 0 and battery <= self.most:
            self.timers.set(battery / resting if battery > self._changes else 0.0, EVERYBODY)

    def _powers(self, mode: int) -> tuple[tuple[int, float], ...]:
        """(cause, W) of a mode other than SCHEDULED."""
        return (
            (self._radio_cause[mode], self._radio[mode]),
            (self._processor_cause[mode], self._processor[mode]),
            (SENSE, self._sensor[mode]),
        )

    def _charges(self, node: int) -> tuple[list[tuple[int, float]], float]:
        """(cause, joules) since the node was settled, negative if paid in advance; and the seconds it was awake."""
        mode, passed = self._mode[node], self._env.now - self._since[node]
        busy, computed = self._radio_busy_of[node], self._computed_of[node]
        if mode != SCHEDULED:
            return [
                (self._radio_cause[mode], self._radio[mode] * (passed - busy)),
                (self._processor_cause[mode], self._processor[mode] * (passed - computed)),
                (SENSE, self._sensor[mode] * passed),
            ], passed
        awake, switches = self._duty_cycles.tally_one(node, self._since[node], self._env.now)
        return self._by_schedule(awake, passed, switches, busy, computed), awake

    def _by_schedule(
        self,
        awake: Number,
        passed: Number,
        switches: Number,
        busy: Number | float = 0.0,
        computed: Number | float = 0.0,
    ) -> list[tuple[int, Number]]:
        """(cause, joules) of a time by schedule of which a part is awake, and of switches. Numbers, or arrays.

        In `busy` and `computed` seconds of the time awake, radio and processor are booked elsewhere.
        """
        asleep = passed - awake
        return [
            (self._radio_cause[AWAKE], self._radio[AWAKE] * (awake - busy)),
            (self._processor_cause[AWAKE], self._processor[AWAKE] * (awake - computed)),
            (SENSE, self._sensor[AWAKE] * awake),
            (self._radio_cause[ASLEEP], self._radio[ASLEEP] * asleep),
            (self._processor_cause[ASLEEP], self._processor[ASLEEP] * asleep),
            (SWITCH, self._per_switch * switches),
        ]

    def pending(self, node: int) -> float:
        """Joules consumed since the node was last settled. Changes nothing."""
        return sum(max(joules, 0.0) for _, joules in self._charges(node)[0])

    def pending_charges(self, nodes: Ints) -> Iterator[tuple[Ints, int, Floats]]:
        """(nodes, cause, joules) consumed since the nodes were settled, in pieces; negative if paid in advance."""
        modes, now = self._modes[nodes], self._env.now
        for mode in np.unique(modes).tolist():
            chosen = nodes[modes == mode]
            passed, busy, computed = now - self._settled_at[chosen], self._radio_busy[chosen], self._computed[chosen]
            if mode == SCHEDULED:
                awake, switches = self._duty_cycles.tally(chosen, self._settled_at[chosen], now)
                for cause, joules in self._by_schedule(awake, passed, switches, busy, computed):
                    yield chosen, cause, joules
                continue
            yield chosen, self._radio_cause[mode], self._radio[mode] * (passed - busy)
            yield chosen, self._processor_cause[mode], self._processor[mode] * (passed - computed)
            if self._sensor[mode]:
                yield chosen, SENSE, self._sensor[mode] * passed

    def settle(self, node: int) -> Charges:
        """Return what a node has consumed since it was last settled, and regard it as booked."""
        charges, passed = self._charges(node)
        charges = [(cause, joules) for cause, joules in charges if joules > 0]
        self._since[node] = self._env.now
        self._radio_busy_of[node] = max(self._radio_busy_of[node] - passed, 0.0)
        self._computed_of[node] = max(self._computed_of[node] - passed, 0.0)
        for cause, joules in charges:
            if cause in self._booked:
                self._booked[cause] += joules
        return charges

    def mark_radio_busy(self, node: int, seconds: float) -> None:
        """The radio of a node sends or receives for this time."""
        mode = self._mode[node]
        self._grand[self._radio_cause[mode]] -= self._radio[mode] * seconds
        self._radio_busy_of[node] += seconds

    def mark_radios_busy(self, nodes: Ints, seconds: float) -> None:
        """`mark_radio_busy` for different nodes (n,)."""
        mark_busy(nodes, seconds, self._radio_busy, self._modes, self._counts, *self._radio_law, self._grand_totals)

    def mark_computing(self, node: int, cycles: float) -> None:
        """The processor of a node computes for a number of cycles."""
        seconds = self._model.seconds(cycles)
        mode = self._mode[node]
        self._grand[self._processor_cause[mode]] -= self._processor[mode] * seconds
        self._computed_of[node] += seconds

    def mark_all_computing(self, nodes: Sequence[int], cycles: Sequence[float]) -> None:
        """`mark_computing` for several nodes in turn, each for cycles of its own."""
        for node, count in zip(nodes, cycles, strict=True):
            self.mark_computing(node, count)

    def sleep_radio(self, node: int, seconds: float) -> Charges:
        """Return the charges of a radio that sleeps for this time, which the caller has marked as busy."""
        joules = self._radio[ASLEEP] * seconds
        if not joules:
            return ()
        self._grand[SLEEP] += joules
        return ((SLEEP, joules),)

    def switching(self, node: int, mode: Mode) -> float:
        """Joules of the change of a node to a mode."""
        return self._model.switching(self._resolved(node, Mode(self._mode[node])), self._resolved(node, mode))

    def _resolved(self, node: int, mode: Mode) -> Mode:
        """The mode, or what the schedule says now if it is SCHEDULED."""
        return mode if mode is not Mode.SCHEDULED else self._duty_cycles.scheduled(node)

    def change_mode(self, node: int, mode: Mode) -> None:
        """A settled node is in another mode from now on."""
        busy, computed = self._radio_busy_of[node], self._computed_of[node]
        for index, sign in ((self._mode[node], -1.0), (int(mode), 1.0)):
            self._grand[self._radio_cause[index]] -= sign * self._radio[index] * busy
            self._grand[self._processor_cause[index]] -= sign * self._processor[index] * computed
            if index != SCHEDULED:
                for cause, power in self._powers(index):
                    self._power[cause] += sign * power
                    self._grand[cause] -= sign * power * self._env.now
        self._mode[node] = int(mode)
        self._since[node] = self._env.now

    def correct(self, cause: int, joules: float) -> None:
        """Add to the network's total of a cause: a node that died could not pay what it consumed, or lost a rest."""
        if cause not in self._booked:
            self._grand[cause] += joules

    def totals(self, settled: list[float]) -> list[float]:
        """The network's totals by cause until now, given the settled ones, without `scheduled_totals`."""
        result = list(settled)
        for cause in OVER_TIME:
            booked = settled[cause] - self._booked[cause] if cause in self._booked else 0.0
            result[cause] = booked + self._grand[cause] + self._power[cause] * self._env.now
        awake, switches, passed = self._duty_cycles.skipped()
        for cause, joules in self._by_schedule(awake, passed, switches):
            result[cause] -= joules
        return result

    def scheduled_totals(self, times: Floats) -> Floats:
        """(T, causes) what all nodes would have consumed by each time, had they only followed their schedules."""
        totals = np.zeros((times.size, len(CAUSES)))
        awake, switches, passed = self._duty_cycles.profile(times)
        for cause, joules in self._by_schedule(awake, passed, switches):
            totals[:, cause] += joules
        return totals

    def watch(self, node: int, left: float) -> None:
        """Set a timer for a node with `left` joules, if it may run out before the end."""
        if left > self.most:
            return
        power, now = self._power_of(node), self._env.now
        if self._mode[node] == SCHEDULED:
            self._watch_schedule(node, left)
            return
        if power <= 0 or now + left / power > self._horizon:
            return
        lasts = left / power
        due = now + (lasts if lasts < NEAR else lasts / 2)
        if self.timers.due(node) > now + lasts:
            self.timers.set(due, node)

    def _watch_schedule(self, node: int, left: float) -> None:
        """Check again when its schedule changes, or earlier if the charge may not last until then."""
        now, most, power = self._env.now, self._most_by_schedule, self._power_of(node)
        due = self._duty_cycles.next_change(node)
        lasts = left / power if power > 0 else math.inf
        if now + lasts < due:
            due = now + (lasts if lasts < NEAR else lasts / 2)
        elif most > 0 and left > self._changes:
            due = max(due, now + left / most / 2)
        if due <= self._horizon and self.timers.due(node) > due:
            self.timers.set(due, node)

    def runs_out(self, node: int, left: float) -> bool:
        """Whether `left` joules of a node are only what rounding leaves."""
        return left <= self._power_of(node) * SOON

    def _power_of(self, node: int) -> float:
        """Power in W of a node now."""
        return self._power_of_mode(int(self._resolved(node, Mode(self._mode[node]))))

    def _power_of_mode(self, mode: int) -> float:
        return self._radio[mode] + self._processor[mode] + self._sensor[mode]
