"""What time costs: idle listening, sleep. Nothing happens until a node spends or is asked: then its past is settled.

A node's draw is a function of its mode, less the seconds in which its radio sent or received, or its processor
computed, which are paid for elsewhere. `totals` needs no look at the nodes: the network's draw is a sum that changes
with a mode. A node that may run dry before the end is watched: an alarm rings at the instant its charge is gone.
"""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.radio import Draws, Mode
from wsnsim.base.tables import CAUSE

if TYPE_CHECKING:
    from wsnsim.network.fleet import Fleet

IDLE, SLEEP = CAUSE["idle"], CAUSE["sleep"]
NEAR: Final = 1e-2
"""A node that lasts for fewer seconds than this is looked at when it dies, others half-way there."""
SOON: Final = 1e-9
"""A charge that lasts for fewer seconds than this is gone: it is what rounding leaves."""


class Drain:
    """The draw of every node. Times in s; `horizon` is when the run ends."""

    def __init__(self, env: simpy.Environment, fleet: Fleet, draws: Draws, horizon: float) -> None:
        self._env = env
        self._fleet = fleet
        self._draws = draws
        self._horizon = horizon
        table = [draws.draw(mode) for mode in Mode]
        self._radio = [float(draw.radio) for draw in table]
        self._processor = [float(draw.processor) for draw in table]
        self._radio_cause = [SLEEP if draw.radio_sleeps else IDLE for draw in table]
        self._processor_cause = [SLEEP if draw.processor_sleeps else IDLE for draw in table]
        self._modes = np.zeros(fleet.size, dtype=np.int8)
        self._sinces, self._busies, self._computes = (np.zeros(fleet.size) for _ in range(3))
        self._mode, self._since = scalars(self._modes), scalars(self._sinces)
        self._busy, self._computed = scalars(self._busies), scalars(self._computes)
        self._grand: dict[int, float] = {IDLE: 0.0, SLEEP: 0.0}
        self._power: dict[int, float] = {IDLE: 0.0, SLEEP: 0.0}
        self._power[self._radio_cause[0]] += fleet.size * self._radio[0]
        self._power[self._processor_cause[0]] += fleet.size * self._processor[0]
        self.most = max(map(sum, zip(self._radio, self._processor, strict=True))) * horizon
        """What a node can draw at most in the whole run, in J."""
        self._alarms: list[tuple[float, int]] = []
        self._due: dict[int, float] = {}
        self._rings_at = float("inf")
        dormant = self._radio[0] + self._processor[0]
        if dormant > 0 and fleet.battery / dormant <= horizon:
            self._ring(fleet.battery / dormant, -1)

    def _shares(self, node: int) -> tuple[float, float]:
        """Joules that the radio and the processor drew since the node was settled; negative: paid for in advance."""
        mode, passed = self._mode[node], self._env.now - self._since[node]
        return self._radio[mode] * (passed - self._busy[node]), self._processor[mode] * (passed - self._computed[node])

    def pending(self, node: int) -> float:
        """Joules drawn since the node was last settled. Changes nothing."""
        return sum(max(share, 0.0) for share in self._shares(node))

    def all_pending(self) -> Floats:
        """(N,) the same of every node."""
        radio, processor = self._drawn(np.arange(self._modes.size))
        return radio + processor

    def _drawn(self, nodes: Ints) -> tuple[Floats, Floats]:
        """What the radios and the processors of nodes drew since they were settled."""
        passed, mode = self._env.now - self._sinces[nodes], self._modes[nodes]
        radio = np.array(self._radio)[mode] * (passed - self._busies[nodes])
        processor = np.array(self._processor)[mode] * (passed - self._computes[nodes])
        return np.maximum(radio, 0.0), np.maximum(processor, 0.0)

    def settle(self, node: int) -> None:
        """Book what a node drew until now. It may have run dry, within rounding of its alarm."""
        mode, passed = self._mode[node], self._env.now - self._since[node]
        radio, processor = self._shares(node)
        self._since[node] = self._env.now
        self._busy[node] = max(self._busy[node] - passed, 0.0)
        self._computed[node] = max(self._computed[node] - passed, 0.0)
        charges = []
        if radio > 0:
            charges.append((self._radio_cause[mode], radio))
        if processor > 0:
            charges.append((self._processor_cause[mode], processor))
        if charges:
            self._fleet.book_drawn(node, tuple(charges))

    def settle_all(self) -> None:
        """Book what every living node drew until now."""
        fleet = self._fleet
        drew = np.flatnonzero(fleet.living & (self.all_pending() > 0))
        tight = fleet.battery - fleet.spent[drew] <= self.most
        for node in drew[tight].tolist():
            self.settle(node)
        self._settle_many(drew[~tight])

    def _settle_many(self, nodes: Ints) -> None:
        """`settle` for nodes that cannot run dry."""
        fleet, mode = self._fleet, self._modes[nodes]
        radio, processor = self._drawn(nodes)
        for drawn, causes in ((radio, self._radio_cause), (processor, self._processor_cause)):
            where = np.array(causes)[mode]
            for cause in (IDLE, SLEEP):
                chosen = where == cause
                fleet.ledger[cause][nodes[chosen]] += drawn[chosen]
                fleet.totals[cause] += float(drawn[chosen].sum())
        fleet.spent[nodes] += radio + processor
        passed = self._env.now - self._sinces[nodes]
        self._sinces[nodes] = self._env.now
        self._busies[nodes] = np.maximum(self._busies[nodes] - passed, 0.0)
        self._computes[nodes] = np.maximum(self._computes[nodes] - passed, 0.0)

    def occupy(self, node: int, seconds: float) -> None:
        """The radio of a node is paid for elsewhere for so many seconds; settles the node."""
        mode = self._mode[node]
        self._grand[self._radio_cause[mode]] -= self._radio[mode] * seconds
        self._busy[node] += seconds
        self.settle(node)

    def occupy_all(self, nodes: Ints, seconds: float) -> None:
        """The same for several nodes, without settling them."""
        self._busies[nodes] += seconds
        for mode, count in enumerate(np.bincount(self._modes[nodes]).tolist()):
            self._grand[self._radio_cause[mode]] -= self._radio[mode] * seconds * count

    def doze(self, nodes: Ints, seconds: float) -> None:
        """The radio of nodes sleeps for so many seconds, whatever their mode."""
        self.occupy_all(nodes, seconds)
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
        return self._draws.switching(Mode(self._mode[node]), mode)

    def change(self, node: int, mode: Mode) -> None:
        """A settled node draws what the new mode draws, from now on."""
        busy, computed = self._busy[node], self._computed[node]
        for index, sign in ((self._mode[node], -1.0), (int(mode), 1.0)):
            self._grand[self._radio_cause[index]] -= sign * self._radio[index] * busy
            self._grand[self._processor_cause[index]] -= sign * self._processor[index] * computed
            for cause, power in (
                (self._radio_cause[index], self._radio[index]),
                (self._processor_cause[index], self._processor[index]),
            ):
                self._power[cause] += sign * power
                self._grand[cause] -= sign * power * self._env.now
        self._mode[node] = int(mode)
        self._since[node] = self._env.now

    def totals(self, settled: list[float]) -> list[float]:
        """The network's totals by cause, where idle and sleep are the draw until now rather than what is settled."""
        result = list(settled)
        for cause in (IDLE, SLEEP):
            result[cause] = self._grand[cause] + self._power[cause] * self._env.now
        return result

    def watch(self, node: int) -> None:
        """Set an alarm for a node that may run dry before the end."""
        left = self._fleet.battery - float(self._fleet.spent[node])
        if left > self.most:
            return
        power, now = self._power_of(node), self._env.now
        if power <= 0 or now + left / power > self._horizon:
            return
        lasts = left / power
        due = now + (lasts if lasts < NEAR else lasts / 2)
        if self._due.get(node, math.inf) > now + lasts or self._due[node] <= now:
            self._due[node] = due = max(due, math.nextafter(now, math.inf))
            self._ring(due, node)

    def _power_of(self, node: int) -> float:
        mode = self._mode[node]
        return self._radio[mode] + self._processor[mode]

    def forgo(self, cause: int, joules: float) -> None:
        """So much was drawn that a dying node no longer had."""
        self._grand[cause] -= joules

    def lose(self, joules: float) -> None:
        """The last of a dying node's charge is gone, booked as idle."""
        self._grand[IDLE] += joules

    def _ring(self, time: float, node: int) -> None:
        heapq.heappush(self._alarms, (time, node))
        if time < self._rings_at:
            self._rings_at = time
            alarm = self._env.timeout(max(time - self._env.now, 0.0))
            assert alarm.callbacks is not None
            alarm.callbacks.append(lambda _: self._look(time))

    def _look(self, time: float) -> None:
        """Bury whose charge is gone by now, and set the next alarm. An alarm that an earlier one replaced is void."""
        if time != self._rings_at:
            return
        self._rings_at = float("inf")
        while self._alarms and self._alarms[0][0] <= self._env.now:
            _, node = heapq.heappop(self._alarms)
            for one in np.flatnonzero(self._fleet.living).tolist() if node < 0 else (node,):
                self._look_at(one)
        if self._alarms:
            self._ring(*heapq.heappop(self._alarms))

    def _look_at(self, node: int) -> None:
        if not self._fleet.alive[node]:
            return
        self.settle(node)
        if not self._fleet.alive[node]:
            return
        if self._fleet.battery - float(self._fleet.spent[node]) <= self._power_of(node) * SOON:
            self._fleet.exhaust(node)
        else:
            self.watch(node)
