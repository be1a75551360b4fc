"""Components of a node other than the radio: processor, clock and its synchronisation, detection, packing of frames.

seconds(cycles) -> s    rates(keys) -> (n,)    distort(readings, keys) -> (n,)    packets(packet_bits, most_bits) -> int
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys, components_of
from wsnsim.base.detections import Interval, space_of, why_no_detections
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.quiet import Upkeep
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import derive_each, normals, uniforms
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models import bounds
from wsnsim.models.access import Framed

OFFSETS: Final = np.array([1], dtype=np.uint64)
"""In a counter key, stands for the error of a clock at the start; the key itself is that of its rate."""


@part
class Processor:
    """The time of computations: cycles divided by the clock rate, or zero without a rate.

    A tracker states operations; each takes `cycles_per_flop` cycles (1 as in the papers; 10 is closer to floating point
    in software).
    """

    rate: Annotated[float | None, bounds.CLOCK_RATE, "clock rate; left out: computing takes no time"] = None
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
    offset: Annotated[float, bounds.SECONDS, "standard deviation of the errors of clocks at the start"] = 0.0

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on the clock of each node per true second."""
        return 1.0 + self.sd * bounds.truncated_normals(keys)

    def offsets(self, keys: Keys) -> Floats:
        """(n,) seconds by which the clock of each node is ahead of true time at the start."""
        return self.offset * bounds.truncated_normals(derive_each(keys, OFFSETS))


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

    missed: Annotated[float, bounds.FAILURE, "probability of a missed detection"] = 0.0
    false_alarm: Annotated[float, bounds.FAILURE, "probability of a false alarm, per step and node out of range"] = 0.0
    bias_sd: Annotated[
        float,
        Quantity("", ge=0.0, le=1e9, label="as readings"),
        "standard deviation of the biases of nodes, in the unit of readings",
    ] = 0.0
    stuck: Annotated[float, bounds.PROBABILITY, "probability that a node is stuck"] = 0.0
    stuck_at: Annotated[float, bounds.READING, "what a stuck node reports, in the unit of readings"] = 0.0

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings as reported, given one counter key per node (equal at every step)."""
        reported = readings + self.bias_sd * normals(keys, 0) if self.bias_sd else readings
        return np.where(uniforms(keys, 2) < self.stuck, self.stuck_at, reported) if self.stuck else reported


CLUTTER = Quantity("", ge=0.0, le=1000.0)
RESOLUTION = Quantity("", ge=0.0, le=1e9, label="as readings")
PROTOCOLS = ("open", "standing")
"""The head protocols that lead groups of tracks."""


@part
class UnlabelledDetection:
    """Scans instead of readings that name their target: detections without an order, misses and false detections.

    Each awake node scans at each step. It detects a target within range with the probability `probability`, and a
    Poisson number of false detections, uniform over the sensor's space: a turn of a bearing, the sensing range of a
    range, or the `window`. Two targets whose readings without noise differ by less than `resolution` in every component
    give one detection, the mean of both. A detection, also a false one, wakes a dormant node as a target does. Each
    takes a packet when the scan is sent, as a reading does.

    Recorded readings are taken as detected, of the target that the file says: only false detections are added to them,
    and `probability` is what heads assume.

    Source: the measurement model of Bar-Shalom, Li (1995): at most one detection of a target, and Poisson clutter.
    """

    false_alarm: ClassVar[float] = 0.0

    probability: Annotated[float, bounds.SHARE, "P_D: probability that a target within range is detected"] = 0.9
    clutter: Annotated[float, CLUTTER, "expected number of false detections in a scan"] = 0.0
    resolution: Annotated[
        tuple[float, ...],
        RESOLUTION,
        "by component of a reading, the difference below which two targets give one detection; none: all are resolved",
    ] = ()
    window: Annotated[
        tuple[Interval, ...],
        bounds.READING,
        "by component of a reading, the interval [least, greatest] of false detections; none: the sensor's space",
    ] = ()

    @property
    def missed(self) -> float:
        """The probability that a target within range is not detected."""
        return 1.0 - self.probability

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings, unchanged."""
        return readings

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a sensor that makes no detections, for a space of clutter, and for others' options."""
        sensor = setup.sensor
        reason = why_no_detections(sensor)
        if reason:
            yield Issue(("sensor", "kind"), reason)
        else:
            yield from self._bad_lengths(sensor)
            yield from self._bad_space(sensor)
        if not isinstance(setup, NetworkSetup):
            yield Issue(("detection", "kind"), "scans are gathered by heads: unlabelled readings need a network")
        elif setup.until_clusters is not None:
            yield Issue(("until",), "groups begin and end: no number of clusters ends a run of unlabelled readings")
        elif setup.head_protocol not in PROTOCOLS:
            yield Issue(
                ("clusters", "kind"),
                "no group of tracks is led so: for unlabelled readings use central, or strongest_signal with "
                "successor_rule: nearest",
            )
        elif setup.wakeup.mechanism != "none":
            yield Issue(("wakeup", "kind"), "nodes are not woken ahead of tracks of unlabelled readings: use none")

    def _bad_lengths(self, sensor: object) -> Iterator[Issue]:
        names = components_of(sensor)
        for key, given in (("resolution", self.resolution), ("window", self.window)):
            if given and len(given) != len(names):
                yield Issue(
                    ("detection", key), f"expected a value per component ({', '.join(names)}), got {len(given)}"
                )

    def _bad_space(self, sensor: object) -> Iterator[Issue]:
        for low, high in self.window:
            if not low < high:
                yield Issue(
                    ("detection", "window"), f"[{low:g}, {high:g}] is empty: the least must be below the greatest"
                )
        if self.clutter and space_of(sensor, self.window) is None:
            names = ", ".join(components_of(sensor))
            message = (
                f"readings of this sensor ({names}) have no bounds: give detection.window, the interval of clutter"
            )
            yield Issue(("detection", "clutter"), message)


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
        int | None, bounds.MANY, "largest number of packets in a frame; left out: what the payload holds"
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


MESSAGE_BITS: Final = 72
"""Bits of a message: root and sender, 16 each, sequence number 8, global time 32 (the TinyOS implementation)."""


@part
class NoSync:
    """Clocks are never corrected: they drift apart, unless the MAC keeps them together."""

    mechanism: ClassVar[str] = "none"

    def upkeep(self, setup: Setup) -> tuple[Upkeep, ...]:
        """Nothing."""
        return ()


SETTLING: Final = 20
"""Periods after which nodes agree on a root and send regularly: its time-out, and points for some hops (ours)."""


@part
class Ftsp:
    """The Flooding Time Synchronization Protocol (FTSP): all nodes follow the clock of the root, the one of lowest id.

    Every node broadcasts a message once per period: the id of the root, a sequence number, and its estimate of the
    root's time at the instant at which the message is sent. A node that receives a new sequence number notes a
    reference point, (its own clock, the root's time), and fits a line through the last eight: offset and skew. Nodes
    that have heard of no root for `root_timeout` periods declare themselves the root, and give way to one of lower id.

    Messages are broadcast through the MAC: they wait for the channel, collide, are paid for and logged ("sync"). A time
    stamp of the MAC layer is wrong by N(0, jitter²), independently for every reception; 1.5 µs is our choice (Mica2
    motes count in steps of about 1 µs). Propagation takes no time. A node that sleeps sends in its next awake spell, at
    a random time, and receives what it is awake for. The root's clock is not corrected: the network agrees, and is as
    far from true time as the root.

    Source: Maróti, Kusy, Simon, Lédeczi (2004), "The flooding time synchronization protocol", SenSys; defaults from
    its implementation in TinyOS (TimeSyncP.nc), the period from the paper (30 s), where TinyOS has 10 s.
    """

    mechanism: ClassVar[str] = "ftsp"

    period: Annotated[
        float, Quantity("s", ge=0.01, le=1e6), "time between the messages of a node, on its own clock"
    ] = 30.0
    bits: Annotated[int, bounds.PAYLOAD, "payload of a message"] = MESSAGE_BITS
    jitter: Annotated[float, Quantity("s", ge=0.0, le=1.0), "standard deviation of a time stamp"] = 1.5e-6
    entries: Annotated[int, Quantity("", ge=2, le=1000), "reference points in the regression"] = 8
    entries_to_send: Annotated[int, bounds.COUNT, "reference points that a node needs to send"] = 3
    entries_to_sync: Annotated[int, bounds.COUNT, "reference points that a node needs to correct its clock"] = 4
    root_timeout: Annotated[
        int, bounds.COUNT, "periods without a message of the root until a node declares itself the root"
    ] = 5
    ignore_root: Annotated[
        int, Quantity("", ge=0, le=1000), "periods for which a new root ignores messages of other roots"
    ] = 4
    outlier: Annotated[
        float, Quantity("s", gt=0.0, le=1e6), "error from which on a reference point is not used; four in a row reset"
    ] = 500e-6

    def upkeep(self, setup: Setup) -> tuple[Upkeep, ...]:
        """A message of every node in each period."""
        return (Upkeep(self.bits, self.period, SETTLING * self.period),)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for clocks that need no synchronisation, and for limits or messages that cannot be kept."""
        if not isinstance(setup, RadioSetup):
            return
        stepped = any(fault.mechanism == "clock_step" for fault in setup.faults)
        if isinstance(setup.clock, PerfectClock) and not stepped:
            message = (
                "every clock shows the true time (clock: perfect): there is nothing to synchronise; use clock drift"
            )
            yield Issue(("sync", "kind"), message)
        for name in ("entries_to_send", "entries_to_sync"):
            if getattr(self, name) > self.entries:
                message = f"a node never has {getattr(self, name)} reference points: sync.entries is {self.entries}"
                yield Issue(("sync", name), message)
        if isinstance(setup.mac, Framed):
            yield from self._unsendable(setup.mac)

    def _unsendable(self, mac: Framed) -> Iterator[Issue]:
        """Yield an issue for a message that fits no frame, or that takes longer than its period."""
        if self.bits > mac.payload_bits:
            yield Issue(("sync", "bits"), f"a frame holds at most {mac.payload_bits} bits, and a message {self.bits}")
        elif (airtime := mac.airtime(mac.bits(self.bits))) > self.period:
            yield Issue(("sync", "period"), f"a message takes {airtime:g} s, more than its period")
