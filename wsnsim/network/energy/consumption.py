"""What time costs: idle listening, sleep. Nothing happens until a node spends or is asked: then its past is settled.

A node's draw is a function of its mode, less the seconds in which its radio sent or received, or its processor
computed, which are paid for elsewhere. `totals` needs no look at the nodes: the network's draw is a sum that changes
with a mode. A node that may run dry before the end is watched: an alarm rings at the instant its charge is gone.

A node that follows a schedule of sleep draws what its schedule says, in closed form. In the network's totals that is
left out, as if nobody ever left its schedule: `scheduled_totals` gives it for many times at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.network.energy.battery_timers import EVERYBODY, BatteryTimers

if TYPE_CHECKING:
    from wsnsim.network.nodes import Nodes

IDLE, SLEEP, SENSE, SWITCH = CAUSE["idle"], CAUSE["sleep"], CAUSE["sense"], CAUSE["switch"]
LAZY: Final = (IDLE, SLEEP, SENSE, SWITCH)
"""Causes on which time is booked."""
AWAKE, ASLEEP, SCHEDULED = int(Mode.AWAKE), int(Mode.ASLEEP), int(Mode.SCHEDULED)
NEAR: Final = 1e-2
"""A node that lasts for fewer seconds than this is looked at when it dies, others half-way there."""
SOON: Final = 1e-9
"""A charge that lasts for fewer seconds than this is gone: it is what rounding leaves."""
FEW: Final = 28
"""Nodes below which a plain loop is faster than an array."""
SHORTEST: Final = 5e-3
"""s: no schedule changes more often, on the average: twice in 10 ms, the shortest period."""


class BackgroundConsumption:
    """The draw of every node. Times in s; `horizon` is when the run ends.

    `looking`: W of a node that is awake, for the readings that it takes to find a target.
    """

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, draws: ContinuousPower, horizon: float, looking: float = 0.0
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._draws = draws
        self._horizon = horizon
        table = [draws.draw(Mode.AWAKE if mode is Mode.SCHEDULED else mode) for mode in Mode]
        self._radio = [float(draw.radio) for draw in table]
        self._processor = [float(draw.processor) for draw in table]
        self._sensor = [looking if mode in (Mode.AWAKE, Mode.SCHEDULED) else 0.0 for mode in Mode]
        self._radio_cause = [SLEEP if draw.radio_sleeps else IDLE for draw in table]
        self._processor_cause = [SLEEP if draw.processor_sleeps else IDLE for draw in table]
        self._change_over = (draws.switching(Mode.AWAKE, Mode.ASLEEP) + draws.switching(Mode.ASLEEP, Mode.AWAKE)) / 2.0
        self._modes = np.full(fleet.size, int(fleet.rest), dtype=np.int8)
        self._sinces, self._busies, self._computes = (np.zeros(fleet.size) for _ in range(3))
        self._mode, self._since = scalars(self._modes), scalars(self._sinces)
        self._busy, self._computed = scalars(self._busies), scalars(self._computes)
        self._grand: dict[int, float] = dict.fromkeys(LAZY, 0.0)
        self._power: dict[int, float] = dict.fromkeys(LAZY, 0.0)
        self._booked: dict[int, float] = {SENSE: 0.0, SWITCH: 0.0}
        if fleet.rest is not Mode.SCHEDULED:
            for cause, power in self._powers(int(fleet.rest)):
                self._power[cause] += fleet.size * power
        self.most = max(map(sum, zip(self._radio, self._processor, self._sensor, strict=True))) * horizon
        """What a node can draw at most in the whole run, in J."""
        if fleet.duty_cycles is not None and self._change_over:
            self.most += fleet.duty_cycles.most_switches(horizon) * self._change_over
        self.alarms = BatteryTimers(env, self._look_at)
        resting = self._power_of_mode(int(fleet.rest))
        if fleet.duty_cycles is not None:
            resting = 2.0 * (resting + self._change_over / SHORTEST)
        if resting > 0 and fleet.battery <= self.most:
            self.alarms.set(fleet.battery / resting, EVERYBODY)

    def _powers(self, mode: int) -> tuple[tuple[int, float], ...]:
        """(cause, W) of a mode that is no schedule."""
        return (
            (self._radio_cause[mode], self._radio[mode]),
            (self._processor_cause[mode], self._processor[mode]),
            (SENSE, self._sensor[mode]),
        )

    def _charges(self, node: int) -> tuple[list[tuple[int, float]], float]:
        """(cause, joules) drawn since the node was settled, negative: paid for in advance; and the seconds since then.

        Of a node that follows a schedule those that it was awake.
        """
        mode, passed = self._mode[node], self._env.now - self._since[node]
        if mode != SCHEDULED:
            return [
                (self._radio_cause[mode], self._radio[mode] * (passed - self._busy[node])),
                (self._processor_cause[mode], self._processor[mode] * (passed - self._computed[node])),
                (SENSE, self._sensor[mode] * passed),
            ], passed
        rota = self._fleet.duty_cycles
        assert rota is not None, "only a rota puts a node on its schedule"
        awake, switches = rota.tally_one(node, self._since[node])
        return self._by_schedule(awake, passed, switches, self._busy[node], self._computed[node]), awake

    def _by_schedule(
        self, awake: Any, passed: Any, switches: Any, busy: Any = 0.0, computed: Any = 0.0
    ) -> list[tuple[int, Any]]:
        """(cause, joules) of so many seconds by schedule, some of them awake, and of so many changes.

        Of `busy` and `computed` of the seconds awake radio and processor are paid for elsewhere. Numbers, or arrays.
        """
        asleep = passed - awake
        return [
            (self._radio_cause[AWAKE], self._radio[AWAKE] * (awake - busy)),
            (self._processor_cause[AWAKE], self._processor[AWAKE] * (awake - computed)),
            (SENSE, self._sensor[AWAKE] * awake),
            (self._radio_cause[ASLEEP], self._radio[ASLEEP] * asleep),
            (self._processor_cause[ASLEEP], self._processor[ASLEEP] * asleep),
            (SWITCH, self._change_over * switches),
        ]

    def pending(self, node: int) -> float:
        """Joules drawn since the node was last settled. Changes nothing."""
        return sum(max(joules, 0.0) for _, joules in self._charges(node)[0])

    def all_pending(self) -> Floats:
        """(N,) the same of every node."""
        pending = np.zeros(self._modes.size)
        for chosen, _, joules in self._pieces(np.arange(self._modes.size)):
            pending[chosen] += np.maximum(joules, 0.0)
        return pending

    def _pieces(self, nodes: Ints) -> Iterator[tuple[Ints, int, Floats]]:
        """(nodes, cause, joules) drawn since they were settled, in pieces; negative: paid for in advance."""
        modes = self._modes[nodes]
        for mode in np.unique(modes).tolist():
            chosen = nodes[modes == mode]
            passed, busy, computed = self._env.now - self._sinces[chosen], self._busies[chosen], self._computes[chosen]
            if mode == SCHEDULED:
                rota = self._fleet.duty_cycles
                assert rota is not None, "only a rota puts a node on its schedule"
                awake, switches = rota.tally(chosen, self._sinces[chosen])
                for cause, joules in self._by_schedule(awake, passed, switches, busy, computed):
                    yield chosen, cause, joules
                continue
            yield chosen, self._radio_cause[mode], self._radio[mode] * (passed - busy)
            yield chosen, self._processor_cause[mode], self._processor[mode] * (passed - computed)
            if self._sensor[mode]:
                yield chosen, SENSE, self._sensor[mode] * passed

    def settle(self, node: int) -> None:
        """Book what a node drew until now. It may have run dry, within rounding of its alarm."""
        charges, passed = self._charges(node)
        charges = [(cause, joules) for cause, joules in charges if joules > 0]
        self._since[node] = self._env.now
        self._busy[node] = max(self._busy[node] - passed, 0.0)
        self._computed[node] = max(self._computed[node] - passed, 0.0)
        if charges:
            for cause, joules in charges:
                if cause in self._booked:
                    self._booked[cause] += joules
            self._fleet.book_drawn(node, tuple(charges))

    def touch(self, node: int, joules: float) -> None:
        """Settle a node that is about to spend so much, if it might run dry; others are settled when they are asked."""
        if self._fleet.battery - self._fleet.spent_by(node) - joules <= 2.0 * self.most:
            self.settle(node)

    def settle_all(self) -> None:
        """Book what every living node drew until now."""
        fleet = self._fleet
        living = np.flatnonzero(fleet.living)
        tight = fleet.battery - fleet.spent[living] <= self.most
        for node in living[tight].tolist():
            self.settle(node)
        self._settle_many(living[~tight])

    def _settle_many(self, nodes: Ints) -> None:
        """`settle` for nodes that cannot run dry."""
        fleet = self._fleet
        for chosen, cause, joules in self._pieces(nodes):
            drawn = np.maximum(joules, 0.0)
            fleet.ledger[cause][chosen] += drawn
            fleet.totals[cause] += float(drawn.sum())
            fleet.spent[chosen] += drawn
        passed = self._env.now - self._sinces[nodes]
        self._sinces[nodes] = self._env.now
        self._busies[nodes] = np.maximum(self._busies[nodes] - passed, 0.0)
        self._computes[nodes] = np.maximum(self._computes[nodes] - passed, 0.0)

    def occupy(self, node: int, seconds: float) -> None:
        """The radio of a node is paid for elsewhere for so many seconds; settles the node, if it might run dry."""
        mode = self._mode[node]
        self._grand[self._radio_cause[mode]] -= self._radio[mode] * seconds
        self._busy[node] += seconds
        self.touch(node, 0.0)

    def occupy_all(self, nodes: Ints, listed: list[int], seconds: float) -> None:
        """The same for several nodes, given twice, as array and list, without settling them."""
        if len(listed) < FEW:
            busy, mode, counts = self._busy, self._mode, [0] * len(Mode)
            for node in listed:
                busy[node] += seconds
                counts[mode[node]] += 1
        else:
            self._busies[nodes] += seconds
            counts = np.bincount(self._modes[nodes]).tolist()
        for index, count in enumerate(counts):
            if count:
                self._grand[self._radio_cause[index]] -= self._radio[index] * seconds * count

    def doze(self, nodes: Ints, seconds: float) -> None:
        """The radio of nodes sleeps for so many seconds, whatever their mode."""
        self.occupy_all(nodes, nodes.tolist(), seconds)
        joules = self._radio[Mode.ASLEEP] * seconds
        if joules:
            for node in nodes.tolist():
                self._grand[SLEEP] += joules
                self._fleet.book_drawn(node, ((SLEEP, joules),))

    def compute(self, node: int, cycles: float) -> None:
        """The processor of a node is paid for elsewhere for so many cycles."""
        seconds = self._draws.seconds(cycles)
        mode = self._mode[node]
        self._grand[self._processor_cause[mode]] -= self._processor[mode] * seconds
        self._computed[node] += seconds

    def switching(self, node: int, mode: Mode) -> float:
        """Joules of a node's change to a mode."""
        return self._draws.switching(self._real(node, Mode(self._mode[node])), self._real(node, mode))

    def _real(self, node: int, mode: Mode) -> Mode:
        """The mode, or what the schedule says now."""
        if mode is not Mode.SCHEDULED:
            return mode
        rota = self._fleet.duty_cycles
        assert rota is not None, "only a rota puts a node on its schedule"
        return rota.scheduled(node)

    def change(self, node: int, mode: Mode) -> None:
        """A settled node draws what the new mode draws, from now on."""
        busy, computed = self._busy[node], self._computed[node]
        for index, sign in ((self._mode[node], -1.0), (int(mode), 1.0)):
            self._grand[self._radio_cause[index]] -= sign * self._radio[index] * busy
            self._grand[self._processor_cause[index]] -= sign * self._processor[index] * computed
            if index != SCHEDULED:
                for cause, power in self._powers(index):
                    self._power[cause] += sign * power
                    self._grand[cause] -= sign * power * self._env.now
        self._mode[node] = int(mode)
        self._since[node] = self._env.now

    def totals(self, settled: list[float]) -> list[float]:
        """The network's totals by cause, where time is the draw until now rather than what is settled.

        What schedules say of nodes that do nothing is left out: see `scheduled_totals`.
        """
        result = list(settled)
        for cause in LAZY:
            booked = settled[cause] - self._booked[cause] if cause in self._booked else 0.0
            result[cause] = booked + self._grand[cause] + self._power[cause] * self._env.now
        if self._fleet.duty_cycles is not None:
            awake, switches, passed = self._fleet.duty_cycles.forgone()
            for cause, joules in self._by_schedule(awake, passed, switches):
                result[cause] -= joules
        return result

    def scheduled_totals(self, times: Floats) -> Floats:
        """(T, causes) what all nodes would have drawn by each time, had they only followed their schedules."""
        totals = np.zeros((times.size, len(CAUSES)))
        if self._fleet.duty_cycles is not None:
            awake, switches = self._fleet.duty_cycles.profile(times)
            for cause, joules in self._by_schedule(awake, self._fleet.size * times, switches):
                totals[:, cause] += joules
        return totals

    def watch(self, node: int) -> None:
        """Set an alarm for a node that may run dry before the end."""
        left = self._fleet.battery - float(self._fleet.spent[node])
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
        if self.alarms.due(node) > now + lasts:
            self.alarms.set(due, node)

    def _watch_schedule(self, node: int, left: float) -> None:
        """Look again when its schedule changes, or before that if it may not last so long."""
        rota, now = self._fleet.duty_cycles, self._env.now
        assert rota is not None, "only a rota puts a node on its schedule"
        most, power = self._power_of_mode(SCHEDULED), self._power_of(node)
        due = rota.next_change(node)
        lasts = left / power if power > 0 else math.inf
        if now + lasts < due:
            due = now + (lasts if lasts < NEAR else lasts / 2)
        elif most > 0:
            due = max(due, now + left / (most + self._change_over / SHORTEST) / 2)
        if due <= self._horizon and self.alarms.due(node) > due:
            self.alarms.set(due, node)

    def _power_of(self, node: int) -> float:
        """W that a node draws now."""
        return self._power_of_mode(int(self._real(node, Mode(self._mode[node]))))

    def _power_of_mode(self, mode: int) -> float:
        return self._radio[mode] + self._processor[mode] + self._sensor[mode]

    def forgo(self, cause: int, joules: float) -> None:
        """So much was drawn that a dying node no longer had."""
        if cause not in self._booked:
            self._grand[cause] -= joules

    def lose(self, joules: float) -> None:
        """The last of a dying node's charge is gone, booked as idle."""
        self._grand[IDLE] += joules

    def _look_at(self, node: int) -> None:
        """Bury a node whose charge is gone by now, or set its next alarm."""
        if node == EVERYBODY:
            for one in np.flatnonzero(self._fleet.living).tolist():
                self._look_at(one)
            return
        if not self._fleet.alive[node]:
            return
        self.settle(node)
        if not self._fleet.alive[node]:
            return
        if self._fleet.battery - float(self._fleet.spent[node]) <= self._power_of(node) * SOON:
            self._fleet.exhaust(node)
        else:
            self.watch(node)
