"""A second, plain account of radios that are mostly off: it integrates the states of one node from event to event.

It shares no code with `wsnsim.network.energy`: every piece of time is booked by what the radio does in it, in the words
of `wsnsim.base.medium_access`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.network.radio_network import RadioNetwork
from wsnsim.base.medium_access import RadioDuty
from wsnsim.base.radio import Mode, ModePower
from wsnsim.base.tables import CAUSE
from wsnsim.models.access import Csma

DUTIES = (RadioDuty(0.125, 2.0, 2 * 192e-6), RadioDuty(0.5, 1.0, 0.02), RadioDuty(0.1, 3.0, 0.03))
LISTEN, SLEEP, START, STOP = 0.06, 0.0014, 7e-6, 2e-6
PROCESSOR = 1e-4
IDLE = {Mode.DORMANT: PROCESSOR, Mode.AWAKE: 0.003, Mode.ASLEEP: 1e-5}
"""W of the processor, which `DORMANT` and `ASLEEP` book as sleep."""


class Power:
    """An energy model with a price for everything. `battery` in J."""

    def __init__(self, battery: float = 1e3, start_time: float = 3e-4) -> None:
        self.battery = battery
        self._start_time = start_time

    def transmit(self, bits, distance):
        return bits * 2e-7, 0.0

    def receive(self, bits):
        return bits * 1e-7

    def compute(self, cycles):
        return 0.0

    def sense(self):
        return 0.0

    def mode_power(self, mode):
        if mode in (Mode.DOWN, Mode.SCHEDULED):
            return ModePower(0.0, False, 0.0, False)
        asleep = mode is Mode.ASLEEP
        return ModePower(SLEEP if asleep else LISTEN, asleep, IDLE[mode], mode is not Mode.AWAKE)

    def switching(self, before, after):
        return 0.0

    def turnaround(self):
        return 0.0

    def seconds(self, cycles):
        return 0.0

    def radio_start(self):
        return self._start_time, START

    def radio_stop(self):
        return self._start_time / 2, STOP


@dataclass
class Account:
    """What one node consumes, and for how long its radio is on. `start_time`: s of a start of the radio."""

    start_time: float = 3e-4
    mode: Mode = Mode.DORMANT
    held: bool = False
    duty: RadioDuty = DUTIES[0]
    on: float = 0.0
    joules: dict[str, float] = field(default_factory=lambda: dict.fromkeys(CAUSE, 0.0))

    def radio(self) -> dict[str, float]:
        """W by cause of the radio, and its share of the time `on`."""
        if self.mode is Mode.DOWN:
            return {}
        if self.mode is Mode.ASLEEP:
            return {"sleep": SLEEP}
        if self.held:
            return {"idle": LISTEN, "on": 1.0}
        interval, starts, on = self.duty
        rest = interval - on - starts * self.start_time * 1.5
        return {
            "idle": LISTEN * on / interval,
            "switch": starts * (START + STOP) / interval,
            "sleep": SLEEP * rest / interval,
            "on": on / interval,
        }

    def pass_time(self, seconds: float) -> None:
        """Let time pass in the present state."""
        for cause, power in self.radio().items():
            if cause == "on":
                self.on += power * seconds
            else:
                self.joules[cause] += power * seconds
        if self.mode is not Mode.DOWN:
            self.joules["idle" if self.mode is Mode.AWAKE else "sleep"] += IDLE[self.mode] * seconds

    def busy(self, seconds: float) -> None:
        """The radio sent or received for this time, which was passed in the present state."""
        if self.held:
            self.joules["idle"] -= LISTEN * seconds
        else:
            self.joules["sleep"] -= SLEEP * seconds
            self.on += seconds

    @property
    def spent(self) -> float:
        """Joules in total."""
        return sum(self.joules.values())


def network_of(count: int, duties: Sequence[RadioDuty] = DUTIES, **components: Any) -> RadioNetwork:
    """Nodes far from each other, with CSMA/CA whose radios are charged as if they followed duties."""
    mac = type("DutyCycledCsma", (Csma,), {"duties": tuple(duties)})()
    return RadioNetwork([(1e4 * i, 0.0) for i in range(count)], mac=mac, **({"energy": Power()} | components))
