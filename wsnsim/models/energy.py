"""What each act costs, in joules.

    transmit(bits, distance) -> (electronics, amplifier)    receive(bits), compute(cycles), sense() -> joules

Idle listening, sleep and switching cost nothing in these models: they allow no conclusion about sleeping.
"""

from __future__ import annotations

import math
from typing import Annotated

from wsnsim.base.part import Quantity, part


@part
class Supply:
    """What the first-order models share: a battery, a radio's electronics, a processor of switched capacitance.

    E_rx = k E_elec, E_cpu = N_c C V² (Jiang, Song, Lin 2013, eqs. 10-11). The paper gives neither battery nor C, V and
    the cycles of an operation: ours are 2 J, a StrongARM-class processor, and 1 (10 is nearer to reals in software).
    """

    electronics: Annotated[float, Quantity("J/bit", ge=0, le=1e6), "E_elec: sending or receiving a bit"] = 50e-9
    battery: Annotated[float, Quantity("J", gt=0), "a node's charge at the start; .inf for no limit"] = 2.0
    capacitance: Annotated[float, Quantity("F", ge=0, le=1e3), "C: capacitance switched in a cycle"] = 0.67e-9
    voltage: Annotated[float, Quantity("V", ge=0, le=1e6), "V_dd: supply of the processor"] = 1.5
    cycles_per_operation: Annotated[
        float, Quantity("", gt=0, le=1e9), "processor cycles that one stated operation takes"
    ] = 1.0
    sensing: Annotated[float, Quantity("J", ge=0, le=1e6), "taking one reading"] = 0.0

    def receive(self, bits: float) -> float:
        """Joules of receiving `bits` (eq. 10)."""
        return bits * self.electronics

    def compute(self, cycles: float) -> float:
        """Joules of `cycles` operations, as trackers state them (eq. 11)."""
        return cycles * self.cycles_per_operation * self.capacitance * self.voltage * self.voltage

    def sense(self) -> float:
        """Joules of one reading."""
        return self.sensing


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
