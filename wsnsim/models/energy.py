"""What each act costs, in joules, and what time costs, in watts.

    transmit(bits, distance) -> (electronics, amplifier)    receive(bits), compute(cycles), sense() -> joules
    draw(mode) -> Draw in watts    switching(before, after), turnaround() -> joules    seconds(cycles)

In the first-order models idle listening, sleep and switching cost nothing unless they are given a price: as they
stand, they allow no conclusion about sleeping. `States` rests on datasheets, where listening costs as much as
receiving.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Any, Final

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.radio import Mode, ModePower
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.links import LogNormal

NOTHING: Final = ModePower(0.0, False, 0.0, False)
"""What a node draws that is down."""


@part
class Supply:
    """What the first-order models share: a battery, a radio's electronics, a processor of switched capacitance.

    E_rx = k E_elec, E_cpu = N_c C V² (Jiang, Song, Lin 2013, eqs. 10-11). The paper gives neither battery nor C and V:
    ours are 2 J and a StrongARM-class processor. `idle`, `sleep` and `switch` are our additions, zero in the paper.
    """

    electronics: Annotated[float, Quantity("J/bit", ge=0, le=1e6), "E_elec: sending or receiving a bit"] = 50e-9
    battery: Annotated[float, Quantity("J", gt=0), "a node's charge at the start; .inf for no limit"] = 2.0
    capacitance: Annotated[float, Quantity("F", ge=0, le=1e3), "C: capacitance switched in a cycle"] = 0.67e-9
    voltage: Annotated[float, Quantity("V", ge=0, le=1e6), "V_dd: supply of the processor"] = 1.5
    sensing: Annotated[float, Quantity("J", ge=0, le=1e6), "taking one reading"] = 0.0
    idle: Annotated[float, Quantity("W", ge=0, le=1e6), "listening while nothing comes, dormant or awake"] = 0.0
    sleep: Annotated[float, Quantity("W", ge=0, le=1e6), "radio and processor off"] = 0.0
    switch: Annotated[float, Quantity("J", ge=0, le=1e6), "one change between dormant, awake and asleep"] = 0.0

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
        """`idle` while the receiver is on, `sleep` while it is not; nothing of a node that is down."""
        if mode is Mode.DOWN:
            return NOTHING
        return (
            ModePower(self.sleep, True, 0.0, True) if mode is Mode.ASLEEP else ModePower(self.idle, False, 0.0, False)
        )

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode; to go down and to come back costs nothing."""
        return 0.0 if before is after or Mode.DOWN in (before, after) else self.switch

    def turnaround(self) -> float:
        """Joules of a change between receiving and sending: none in these models."""
        return 0.0

    def seconds(self, cycles: float) -> float:
        """How long computing takes: not known in these models, 0."""
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
    microsensor networks". Battery and processor as in `FirstOrder`; its cost of aggregating signals
    is left out: what a tracker computes is stated in operations.
    """

    free_space: Annotated[float, Quantity("J/bit/m2", ge=1e-30, le=1e6), "ε_fs: radiating a bit over a short link"] = (
        10e-12
    )
    multipath: Annotated[float, Quantity("J/bit/m4", ge=1e-30, le=1e6), "ε_mp: radiating a bit over a long link"] = (
        0.0013e-12
    )

    @property
    def crossover(self) -> float:
        """d0 in m: where free space ends and multipath begins."""
        return math.sqrt(self.free_space / self.multipath)

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending `bits` over `distance` m."""
        near = distance < self.crossover
        return bits * self.electronics, bits * (self.free_space * distance**2 if near else self.multipath * distance**4)


@part
class States:
    """Power by state from datasheets: sending, receiving, listening, sleeping, computing, waiting, changing over.

    E_tx = P_tx k / rate at the output power's level, E_rx = P_rx k / rate, E_cpu = P_run N_c / f. A datasheet does not
    split electronics and amplifier: all of sending is booked as electronics, whatever the distance.

    A dormant node listens while its processor sleeps; asleep, both are off. A processor that wakes draws what it
    draws when it runs (our choice); to crash and to restart costs nothing (our choice).

    The battery is two AA cells: 18,720 J, as in Castalia 3.
    """

    radio: Annotated[RadioSheet, "datasheet of the radio, or the name of one"]
    processor: Annotated[ProcessorSheet, "datasheet of the processor, or the name of one"]
    power: Annotated[float, Quantity("dBm", ge=-200.0, le=60.0), "output power: one of the radio's levels"] = 0.0
    battery: Annotated[float, Quantity("J", gt=0), "a node's charge at the start; .inf for no limit"] = 18_720.0
    sensing: Annotated[float, Quantity("J", ge=0, le=1e6), "taking one reading"] = 0.0

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending `bits`: all of it the first, whatever the distance."""
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
        """The sheets' powers in the mode."""
        radio, processor = self.radio, self.processor
        if mode is Mode.DORMANT:
            return ModePower(radio.listen, False, processor.sleep, True)
        if mode is Mode.AWAKE:
            return ModePower(radio.listen, False, processor.idle, False)
        return ModePower(radio.sleep, True, processor.sleep, True) if mode is Mode.ASLEEP else NOTHING

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode: the radio's start or stop, and the processor's waking."""
        if Mode.DOWN in (before, after):
            return 0.0
        radio, processor, joules = self.radio, self.processor, 0.0
        if before is Mode.ASLEEP and after is not Mode.ASLEEP:
            joules += radio.wake * radio.wake_power
        if after is Mode.ASLEEP and before is not Mode.ASLEEP:
            joules += radio.doze * radio.doze_power
        if after is Mode.AWAKE and before is not Mode.AWAKE:
            joules += processor.wake * processor.run
        return joules

    def turnaround(self) -> float:
        """Joules of one change of the radio between receiving and sending."""
        return self.radio.turnaround * self.radio.turnaround_power

    def seconds(self, cycles: float) -> float:
        """How long the processor is busy with so many cycles."""
        return cycles / self.processor.rate

    def check(self, setup: Setup) -> Iterator[Issue]:
        """An output power that the radio does not have, or a link or a MAC of another radio."""
        levels = self.radio.levels
        if self.power not in levels:
            nearest = min(levels, key=lambda level: abs(level - self.power))
            yield Issue(
                ("energy", "power"),
                f"{self.power:g} dBm is no output power of {self.radio.name}: it has "
                f"{', '.join(f'{level:g}' for level in levels)} dBm (nearest: {nearest:g} dBm)",
            )
        link = setup.link if isinstance(setup, RadioSetup) else None
        if isinstance(link, LogNormal) and link.power != self.power:
            yield Issue(
                ("energy", "power"), f"{self.power:g} dBm is not link.power = {link.power:g} dBm: they must agree"
            )
        yield from self._other_radio(setup)

    def _other_radio(self, setup: Setup) -> Iterator[Issue]:
        """What the sheet says otherwise than the link or the MAC."""
        if not isinstance(setup, RadioSetup):
            return
        pairs: list[tuple[str, str, str, Any]] = [("mac", "turnaround", "s", self.radio.turnaround)]
        if isinstance(setup.link, LogNormal):
            pairs.append(("link", "sensitivity", "dBm", self.radio.sensitivity))
            pairs.append(("link", "modulation", "", self.radio.modulation))
        for role, name, unit, said in pairs:
            found = getattr(getattr(setup, role), name, said)
            if found != said:
                yield Issue(
                    (role, name),
                    f"{found} {unit}".strip() + f" is not that of {self.radio.name}: {said} {unit}".rstrip(),
                )

    @cached_property
    def _per_bit(self) -> float:
        """Joules of sending a bit at the output power, or at the nearest one that the sheet has."""
        level = min(range(len(self.radio.levels)), key=lambda i: abs(self.radio.levels[i] - self.power))
        return self.radio.transmit[level] / self.radio.rate
