"""Energy models: the energy of each act in joules, and the power in each mode in watts.

    transmit(bits, distance) -> (electronics, amplifier)    receive(bits), compute(cycles), sense() -> joules
    mode_power(mode) -> ModePower in watts    switching(before, after), turnaround() -> joules    seconds(cycles)

In the first-order models idle listening, sleep and switching cost nothing by default: without prices for them, these
models allow no conclusion about sleeping. `States` uses datasheets, where listening costs as much as receiving.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Any, Final

from wsnsim.base.errors import Issue, did_you_mean
from wsnsim.base.part import Quantity, part
from wsnsim.base.radio import Mode, ModePower
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.bounds import JOULES, LEVEL
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet, RadioSleep
from wsnsim.models.links import LogNormal

NOTHING: Final = ModePower(0.0, False, 0.0, False)
"""The power of a node that is down."""


@part
class Supply:
    """The fields of both first-order models: battery, electronics of the radio, processor of switched capacitance.

    E_rx = k E_elec, E_cpu = N_c C V² (Jiang, Song, Lin 2013, eqs. 10-11). The paper gives neither battery nor C and V:
    ours are 2 J and a StrongARM-class processor. `idle`, `sleep` and `switch` are our additions, zero in the paper.
    """

    electronics: Annotated[float, Quantity("J/bit", ge=0, le=1e6), "E_elec: sending or receiving a bit"] = 50e-9
    battery: Annotated[float, Quantity("J", gt=0), "initial charge of a node; .inf for no limit"] = 2.0
    capacitance: Annotated[float, Quantity("F", ge=0, le=1e3), "C: capacitance switched per cycle"] = 0.67e-9
    voltage: Annotated[float, Quantity("V", ge=0, le=1e6), "V_dd: supply voltage of the processor"] = 1.5
    sensing: Annotated[float, JOULES, "energy of one reading"] = 0.0
    idle: Annotated[float, Quantity("W", ge=0, le=1e6), "idle listening, dormant or awake"] = 0.0
    sleep: Annotated[float, Quantity("W", ge=0, le=1e6), "radio and processor off"] = 0.0
    switch: Annotated[float, JOULES, "energy of one change between dormant, awake and asleep"] = 0.0

    def receive(self, bits: float) -> float:
        """Joules of receiving `bits` (eq. 10)."""
        return bits * self.electronics

    def compute(self, cycles: float) -> float:
        """Joules of `cycles` of the processor (eq. 11)."""
        return cycles * self.capacitance * self.voltage * self.voltage

    def sense(self) -> float:
        """Joules of one reading."""
        return self.sensing

    def mode_power(self, mode: Mode) -> ModePower:
        """Return `idle` while the receiver is on, `sleep` while it is off, and zero for a node that is down."""
        if mode is Mode.DOWN:
            return NOTHING
        return (
            ModePower(self.sleep, True, 0.0, True) if mode is Mode.ASLEEP else ModePower(self.idle, False, 0.0, False)
        )

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode; going down and coming back cost nothing."""
        return 0.0 if before is after or Mode.DOWN in (before, after) else self.switch

    def radio_start(self) -> tuple[float, float]:
        """Return no time and `switch` joules: a start of the radio alone is a change, too."""
        return 0.0, self.switch

    def radio_stop(self) -> tuple[float, float]:
        """Return no time and `switch` joules: a stop of the radio alone is a change, too."""
        return 0.0, self.switch

    def turnaround(self) -> float:
        """Joules of a change between receiving and sending: none in these models."""
        return 0.0

    def seconds(self, cycles: float) -> float:
        """Return 0: these models do not know how long computing takes."""
        return 0.0


@part
class FirstOrder(Supply):
    """Radio electronics per bit, and an amplifier per bit and squared distance; computing by switched capacitance.

    E_tx = k E_elec + k E_amp d², E_rx = k E_elec, E_cpu = N_c C V².

    Source: Jiang, Song, Lin (2013), eqs. 9-11, after Heinzelman and others (2000).
    """

    amplifier: Annotated[float, Quantity("J/bit/m2", ge=0, le=1e6), "E_amp: radiating a bit"] = 100e-12

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending `bits` over `distance` m (eq. 9)."""
        return bits * self.electronics, bits * self.amplifier * distance * distance


@part
class FirstOrder2002(Supply):
    """Free space up to a crossover distance, multipath fading beyond it.

    E_tx = k E_elec + k ε_fs d² for d < d0, k E_elec + k ε_mp d⁴ beyond, with d0 = sqrt(ε_fs / ε_mp), where both agree.

    Source: Heinzelman, Chandrakasan, Balakrishnan (2002), "An application-specific protocol architecture for wireless
    microsensor networks". Battery and processor are those of `FirstOrder`. The paper's energy of
    aggregating signals is left out, since a tracker states its operations.
    """

    free_space: Annotated[float, Quantity("J/bit/m2", ge=1e-30, le=1e6), "ε_fs: radiating a bit over a short link"] = (
        10e-12
    )
    multipath: Annotated[float, Quantity("J/bit/m4", ge=1e-30, le=1e6), "ε_mp: radiating a bit over a long link"] = (
        0.0013e-12
    )

    @property
    def crossover(self) -> float:
        """d0 in m: the distance at which multipath replaces free space."""
        return math.sqrt(self.free_space / self.multipath)

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending `bits` over `distance` m."""
        near = distance < self.crossover
        return bits * self.electronics, bits * (self.free_space * distance**2 if near else self.multipath * distance**4)


@part
class States:
    """Power by state from datasheets: sending, receiving, listening, sleeping, computing, waiting, switching.

    E_tx = P_tx k / rate at the level of the output power, E_rx = P_rx k / rate, E_cpu = P_run N_c / f. A datasheet does
    not separate electronics and amplifier: sending is booked as electronics, at any distance.

    In a scenario, sensitivity and modulation of the link, bit rate and turnaround of the MAC are those of the radio if
    nothing is written; durations that the MAC counts in symbols are as many symbols of 4 bits at that rate (our choice
    for radios that do not follow IEEE 802.15.4). The output powers of link and energy model follow each other.

    A dormant node listens while its processor sleeps; asleep, the radio is in its `sleep_state` too. A radio that the
    MAC of an awake node turns off is in its `off_state`: the same, or the one with the least power that the radio can
    leave in time. So a CC2420 with ContikiMAC is in idle mode between its channel checks. The power of a
    processor that wakes is that of one that runs (our choice); crashing and restarting cost nothing (our choice).

    The battery is two AA cells: 18,720 J, as in Castalia 3.
    """

    radio: Annotated[RadioSheet, "datasheet of the radio, or its name"]
    processor: Annotated[ProcessorSheet, "datasheet of the processor, or its name"]
    power: Annotated[float, LEVEL, "output power: one of the levels of the radio"] = 0.0
    battery: Annotated[float, Quantity("J", gt=0), "initial charge of a node; .inf for no limit"] = 18_720.0
    sensing: Annotated[float, JOULES, "energy of one reading"] = 0.0
    sleep_state: Annotated[
        str | None, "sleep state of the radio, one of its `sleep_states`; left out: the one that its `sleep` belongs to"
    ] = None
    off_state: Annotated[
        str | None,
        "sleep state of a radio that the MAC turns off; left out: `sleep_state`, or what the MAC has time for",
    ] = None

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending `bits`: the amplifier's are zero, at any distance."""
        return bits * self._per_bit, 0.0

    def receive(self, bits: float) -> float:
        """Joules of receiving `bits`."""
        return bits * self.radio.receive / self.radio.rate

    def compute(self, cycles: float) -> float:
        """Joules of `cycles` of the processor."""
        return cycles * self.processor.cycle

    def sense(self) -> float:
        """Joules of one reading."""
        return self.sensing

    def mode_power(self, mode: Mode) -> ModePower:
        """Return the power of the datasheets in a mode."""
        radio, processor = self.radio, self.processor
        if mode is Mode.DORMANT:
            return ModePower(radio.listen, False, processor.sleep, True)
        if mode is Mode.AWAKE:
            return ModePower(radio.listen, False, processor.idle, False)
        return ModePower(self._sleep.power, True, processor.sleep, True) if mode is Mode.ASLEEP else NOTHING

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode: starting or stopping the radio, and waking the processor."""
        if Mode.DOWN in (before, after):
            return 0.0
        radio, processor, joules = self.radio, self.processor, 0.0
        if before is Mode.ASLEEP and after is not Mode.ASLEEP:
            joules += self._sleep.wake * self._sleep.wake_power
        if after is Mode.ASLEEP and before is not Mode.ASLEEP:
            joules += radio.doze * radio.doze_power
        if after is Mode.AWAKE and before is not Mode.AWAKE:
            joules += processor.wake * processor.run
        return joules

    def radio_start(self) -> tuple[float, float]:
        """(s, J) of the radio from its `off_state` to listening."""
        return self._off.wake, self._off.wake * self._off.wake_power

    def radio_stop(self) -> tuple[float, float]:
        """(s, J) of the radio from listening to its `off_state`."""
        return self.radio.doze, self.radio.doze * self.radio.doze_power

    def radio_off(self) -> float:
        """W of a radio in its `off_state`."""
        return self._off.power

    def turnaround(self) -> float:
        """Joules of one change of the radio between receiving and sending."""
        return self.radio.turnaround * self.radio.turnaround_power

    def seconds(self, cycles: float) -> float:
        """Seconds for which the processor is busy with `cycles`."""
        return cycles / self.processor.rate

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues: an output power or a sleep state that the radio lacks, a link or a MAC of another radio."""
        levels = self.radio.levels
        if self.power not in levels:
            nearest = min(levels, key=lambda level: abs(level - self.power))
            yield Issue(
                ("energy", "power"),
                f"{self.power:g} dBm is not an output power of {self.radio.name}, which has "
                f"{', '.join(f'{level:g}' for level in levels)} dBm (nearest: {nearest:g} dBm)",
            )
        link = setup.link if isinstance(setup, RadioSetup) else None
        if isinstance(link, LogNormal) and link.power != self.power:
            yield Issue(
                ("energy", "power"), f"{self.power:g} dBm is not link.power = {link.power:g} dBm: they must agree"
            )
        unknown = list(self._unknown_sleep_states())
        yield from unknown or self._late_starts(setup)
        yield from self._other_radio(setup)

    def _unknown_sleep_states(self) -> Iterator[Issue]:
        """Yield an issue for each sleep state that the radio lacks."""
        states, name = self.radio.sleep_states, self.radio.name
        for key in ("sleep_state", "off_state"):
            state = getattr(self, key)
            if state is not None and state not in states:
                message = f"{name} has no sleep states to select: leave it out"
                if states:
                    message = f"'{state}' is not a sleep state of {name} ({did_you_mean(state, states)})"
                yield Issue(("energy", key), message)

    def _late_starts(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues if sleeping nodes have to listen before their radios have stopped and started."""
        least = self.radio.doze + self._sleep.wake
        spans = (
            ("sleep", "period", getattr(getattr(setup, "sleep", None), "shortest_sleep", math.inf), "asleep at a time"),
            ("wakeup", "call", getattr(getattr(setup, "wakeup", None), "call", 0.0) or math.inf, "called"),
        )
        for role, key, seconds, what in spans:
            if seconds < least:
                yield Issue(
                    (role, key),
                    f"nodes would be {what} for {seconds:g} s; to turn {self.radio.name} off and on takes {least:g} s",
                )

    def _other_radio(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for each value of the link or the MAC that differs from the datasheet."""
        if not isinstance(setup, RadioSetup):
            return
        pairs: list[tuple[str, str, str, Any]] = [("mac", "turnaround", "s", self.radio.turnaround)]
        if isinstance(setup.link, LogNormal):
            if not setup.link.fitted_on:  # the measured sensitivity has the noise of the place in it
                pairs.append(("link", "sensitivity", "dBm", self.radio.sensitivity))
            pairs.append(("link", "modulation", "", self.radio.modulation))
        for role, name, unit, expected in pairs:
            found = getattr(getattr(setup, role), name, expected)
            if found != expected:
                yield Issue(
                    (role, name),
                    f"{found} {unit}".strip() + f" is not that of {self.radio.name}: {expected} {unit}".rstrip(),
                )

    @cached_property
    def _sleep(self) -> RadioSleep:
        """The sleep state of the radio."""
        return self.radio.sleeping(self.sleep_state)

    @cached_property
    def _off(self) -> RadioSleep:
        """The sleep state of a radio that a MAC turns off."""
        return self._sleep if self.off_state is None else self.radio.sleeping(self.off_state)

    @cached_property
    def _per_bit(self) -> float:
        """Joules of sending one bit at the level nearest to the output power."""
        level = min(range(len(self.radio.levels)), key=lambda i: abs(self.radio.levels[i] - self.power))
        return self.radio.transmit[level] / self.radio.rate
