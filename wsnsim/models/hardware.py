"""Components of a node other than the radio: processor, clock, detection; also the packing of frames, and the sink.

seconds(cycles) -> s    rates(keys) -> (n,)    distort(readings, keys) -> (n,)    packets(packet_bits, most_bits) -> int
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import derive_each, normals, uniforms
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.bounds import PLACE, truncated_normals
from wsnsim.models.workloads import sink_issues

OFFSETS: Final = np.array([1], dtype=np.uint64)
"""In a counter key, stands for the error of a clock at the start; the key itself is that of its rate."""


@part
class Processor:
    """The time of computations: cycles divided by the clock rate, or zero without a rate.

    A tracker states operations; each takes `cycles_per_flop` cycles (1 as in the papers; 10 is closer to floating point
    in software).
    """

    rate: Annotated[float | None, Quantity("Hz", ge=1.0, le=1e12), "clock rate; left out: computing takes no time"] = (
        None
    )
    cycles_per_flop: Annotated[
        float, Quantity("", gt=0, le=1e9), "processor cycles of one operation stated by a tracker"
    ] = 1.0

    def seconds(self, cycles: float) -> float:
        """Simulated seconds that `cycles` take."""
        return 0.0 if self.rate is None else cycles / self.rate

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for a rate that differs from the processor datasheet of the energy model."""
        sheet = getattr(setup.energy, "processor", None) if isinstance(setup, RadioSetup) else None
        if sheet is not None and self.rate is not None and self.rate != sheet.rate:
            yield Issue(
                ("cpu", "rate"),
                f"{self.rate:g} Hz is not the rate of energy.processor ({sheet.name}): {sheet.rate:g} Hz",
            )


@part
class PerfectClock:
    """The clock of every node shows the true time."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) ones."""
        return np.ones(len(keys))


@part
class DriftingClock:
    """The clock of each node runs fast or slow by a constant rate error: N(0, sd²), truncated at three deviations.

    At the start it is wrong by N(0, offset²), truncated in the same way; 0: the network was synchronised before. 30 ppm
    is the tolerance of a quartz; the truncated normal distributions are our choice.
    """

    sd: Annotated[float, Quantity("", ge=0.0, le=0.01), "standard deviation of the rates from 1"] = 30e-6
    offset: Annotated[
        float, Quantity("s", ge=0.0, le=1e6), "standard deviation of the errors of clocks at the start"
    ] = 0.0

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on the clock of each node per true second."""
        return 1.0 + self.sd * truncated_normals(keys)

    def offsets(self, keys: Keys) -> Floats:
        """(n,) seconds by which the clock of each node is ahead of true time at the start."""
        return self.offset * truncated_normals(derive_each(keys, OFFSETS))


@part
class PerfectDetection:
    """Every node reports what its sensor measures."""

    missed: ClassVar[float] = 0.0
    false_alarm: ClassVar[float] = 0.0

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings, unchanged."""
        return readings


@part
class ImperfectDetection:
    """Sensors with missed detections, false alarms, constant biases and stuck readings.

    The bias of a node is N(0, bias_sd²) for the whole run; a stuck node always reports `stuck_at` (our choices). Of
    readings with several components, each is biased and stuck by itself, by these values in its own unit. The filters
    do not model any of this.
    """

    missed: Annotated[float, Quantity("", ge=0.0, lt=1.0), "probability of a missed detection"] = 0.0
    false_alarm: Annotated[
        float, Quantity("", ge=0.0, lt=1.0), "probability of a false alarm, per step and node out of range"
    ] = 0.0
    bias_sd: Annotated[
        float,
        Quantity("", ge=0.0, le=1e9, label="as readings"),
        "standard deviation of the biases of nodes, in the unit of readings",
    ] = 0.0
    stuck: Annotated[float, Quantity("", ge=0.0, le=1.0), "probability that a node is stuck"] = 0.0
    stuck_at: Annotated[
        float,
        Quantity("", ge=-1e18, le=1e18, label="as readings"),
        "what a stuck node reports, in the unit of readings",
    ] = 0.0

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings as reported, given one counter key per node (equal at every step)."""
        reported = readings + self.bias_sd * normals(keys, 0) if self.bias_sd else readings
        return np.where(uniforms(keys, 2) < self.stuck, self.stuck_at, reported) if self.stuck else reported


@part
class NoPacking:
    """Each packet of a burst is sent in a frame of its own."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """Return 1."""
        return 1


@part
class Frames:
    """A frame carries as many packets of a burst as its payload holds."""

    most: Annotated[
        int | None,
        Quantity("", ge=1, le=10_000),
        "largest number of packets in a frame; left out: what the payload holds",
    ] = None

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """Packets of `packet_bits` in a frame whose payload holds `most_bits`; at least 1."""
        held = max(1, most_bits // packet_bits)
        return held if self.most is None else min(held, self.most)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for a MAC without frames, and for frames that hold fewer packets."""
        if not isinstance(setup, RadioSetup):
            return
        payload = getattr(setup.mac, "payload_bits", None)
        if payload is None:
            yield Issue(("packing", "kind"), f"mac '{setup.mac.mechanism}' has no frames: use kind none")
        elif self.most is not None and self.most * PACKET_BITS > payload >= PACKET_BITS:
            yield Issue(
                ("packing", "most"),
                f"{self.most} packets of {PACKET_BITS} bits do not fit a frame, which holds {payload // PACKET_BITS}; "
                f"leave it out to fill frames",
            )


@part
class NoSink:
    """No sink: the estimates stay at the cluster heads."""

    point: ClassVar[tuple[float, float] | None] = None
    bits: ClassVar[int] = 0
    every: ClassVar[float | None] = None


@part
class NearestNode:
    """The sink is the node nearest to a point. It receives the estimates over several hops (our choice), never sleeps.

    By default a report is one packet of Jiang et al. (2013), 12 bytes.
    """

    x: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    y: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    bits: Annotated[int, Quantity("", ge=1, le=1_000_000, label="bit"), "bits of a report"] = PACKET_BITS
    every: Annotated[
        float | None, Quantity("s", gt=0.0, le=1e9), "time between reports; left out: every estimate is reported"
    ] = None

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) in m."""
        return self.x, self.y

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for reports at times that are not steps, and for a sink that no route reaches."""
        yield from sink_issues(setup, self.every)
