"""What a node is besides its radio: processor, clock, sensor's faithfulness; what a frame packs, and who is told.

seconds(cycles) -> s    rates(keys) -> (n,)    distort(readings, keys) -> (n,)    packets(packet_bits, most_bits) -> int
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import normals, uniforms
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.bounds import PLACE
from wsnsim.models.draws import truncated_normals


@part
class Processor:
    """How long computing takes: cycles over the clock's rate, or no time at all if none is given.

    A tracker states operations; one of them takes `cycles_per_flop` cycles (1 as in the papers; 10 is nearer to real
    numbers in software).
    """

    rate: Annotated[float | None, Quantity("Hz", ge=1.0, le=1e12), "of the clock; left out: no time passes"] = None
    cycles_per_flop: Annotated[
        float, Quantity("", gt=0, le=1e9), "processor cycles of one operation that a tracker states"
    ] = 1.0

    def seconds(self, cycles: float) -> float:
        """Simulated seconds that so many cycles take."""
        return 0.0 if self.rate is None else cycles / self.rate

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A rate that is not that of the processor on whose datasheet the energy model rests."""
        sheet = getattr(setup.energy, "processor", None) if isinstance(setup, RadioSetup) else None
        if sheet is not None and self.rate is not None and self.rate != sheet.rate:
            yield Issue(
                ("cpu", "rate"),
                f"{self.rate:g} Hz is not the rate of energy.processor ({sheet.name}): {sheet.rate:g} Hz",
            )


@part
class PerfectClock:
    """Every node's clock is true."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) ones."""
        return np.ones(len(keys))


@part
class DriftingClock:
    """Each node's clock runs fast or slow by a share of its own, which stays: N(0, sd²) within three deviations.

    30 ppm is a quartz's tolerance; the normal and where it ends are our choice.
    """

    sd: Annotated[float, Quantity("", ge=0.0, le=0.01), "standard deviation of the rates about 1"] = 30e-6

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on each node's clock in one true second."""
        return 1.0 + self.sd * truncated_normals(keys)


@part
class PerfectDetection:
    """Every node reports what its sensor measures."""

    missed: ClassVar[float] = 0.0
    false_alarm: ClassVar[float] = 0.0

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings as they are."""
        return readings


@part
class ImperfectDetection:
    """Sensors that miss the target, hear what is not there, are off by a constant, or are stuck.

    A node's bias is N(0, bias_sd²) and lasts; a stuck node reports `stuck_at` whatever it measures (our choices). The
    filters know nothing of it.
    """

    missed: Annotated[float, Quantity("", ge=0.0, lt=1.0), "probability that a reading is not taken"] = 0.0
    false_alarm: Annotated[
        float, Quantity("", ge=0.0, lt=1.0), "probability a node and step that one out of range reports all the same"
    ] = 0.0
    bias_sd: Annotated[
        float, Quantity("", ge=0.0, le=1e9), "standard deviation of the nodes' biases, in the reading's unit"
    ] = 0.0
    stuck: Annotated[float, Quantity("", ge=0.0, le=1.0), "probability that a node is stuck"] = 0.0
    stuck_at: Annotated[float, Quantity("", ge=-1e18, le=1e18), "what a stuck node reports, in the reading's unit"] = (
        0.0
    )

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings as reported, given a counter key a node (equal at every step)."""
        reported = readings + self.bias_sd * normals(keys, 0) if self.bias_sd else readings
        return np.where(uniforms(keys, 2) < self.stuck, self.stuck_at, reported) if self.stuck else reported


@part
class NoPacking:
    """Each packet of a burst travels in a frame of its own."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """One, whatever its size."""
        return 1


@part
class Frames:
    """As many packets of a burst travel in one frame as its payload holds."""

    most: Annotated[int | None, Quantity("", ge=1, le=10_000), "packets in a frame; left out: what it holds"] = None

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """Of this size, in a frame whose payload holds so many bits; at least 1."""
        held = max(1, most_bits // packet_bits)
        return held if self.most is None else min(held, self.most)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A MAC without frames, or frames that hold fewer packets."""
        if not isinstance(setup, RadioSetup):
            return
        payload = getattr(setup.mac, "payload_bits", None)
        if payload is None:
            yield Issue(("packing", "kind"), f"there are no frames in mac '{setup.mac.mechanism}': use kind none")
        elif self.most is not None and self.most * PACKET_BITS > payload >= PACKET_BITS:
            yield Issue(
                ("packing", "most"),
                f"{self.most} packets of {PACKET_BITS} bits do not fit a frame, which holds {payload // PACKET_BITS}; "
                f"left out, frames are filled",
            )


@part
class NoSink:
    """Nobody is told of the estimates: they stay with the heads."""

    point: ClassVar[tuple[float, float] | None] = None
    bits: ClassVar[int] = 0
    every: ClassVar[float | None] = None


@part
class NearestNode:
    """The node nearest to a point is told of estimates, over as many hops as it takes (our choice). It never sleeps.

    A report is one packet of Jiang's, 12 bytes, unless it is said to be longer.
    """

    x: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    y: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    bits: Annotated[int, Quantity("", ge=1, le=1_000_000), "of a report"] = PACKET_BITS
    every: Annotated[
        float | None, Quantity("s", gt=0.0, le=1e9), "between reports; left out: every estimate is reported"
    ] = None

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) in m."""
        return self.x, self.y

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Reports at other instants than steps."""
        if self.every is not None:
            steps = self.every / setup.dt
            if abs(steps - round(steps)) > 1e-9 * steps or round(steps) < 1:
                yield Issue(("sink", "every"), f"{self.every:g} s must be a whole number of steps of {setup.dt:g} s")
