"""When a frame gets the channel, and what a frame is: the parameters of what the network room performs.

    bits(payload bits) -> bits on the air    airtime(bits) -> s    spacing(bits) -> s between a sender's frames

Defaults: IEEE 802.15.4-2006 at 2.4 GHz, 62.5 ksymbol/s, two symbols a byte (a symbol is 16 µs).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import BeaconSetup, NetworkSetup, RadioSetup, Setup

RATE: Final = Quantity("bit/s", ge=1.0, le=1e12)
SPAN: Final = Quantity("s", ge=0.0, le=10.0)
TICK: Final = Quantity("s", ge=1e-6, le=10.0)
"""Of a wait that must take time."""


@part
class IdealMac:
    """No contention and no collisions: a frame is delivered within the instant, or after its airtime if `rate` is set.

    The world of Jiang, Song, Lin (2013), where only the payload's bits cost energy.
    """

    mechanism: ClassVar[str] = "ideal"

    rate: Annotated[float | None, Quantity("bit/s", ge=1e-3), "of the air; left out: no time passes"] = None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A rate that is not the radio's."""
        if self.rate is not None:
            yield from _other_rate(self.rate, setup)


@part
class Framed:
    """What every MAC with frames shares: what surrounds a payload, how long it takes, and what follows it.

    A frame is the PHY's preamble, delimiter and length, then the PSDU: header, payload, checksum. Its receiver
    acknowledges a unicast, without contention, after the turnaround; a broadcast is never acknowledged nor repeated.

    Source: IEEE 802.15.4-2006: PHY overhead 6.3; aMaxPHYPacketSize and aTurnaroundTime 6.4.1; header with short
    addresses and one PAN id, checksum 7.2.1; acknowledgement 7.2.2.3; SIFS, LIFS and aMaxSIFSFrameSize 7.5.1.3;
    macAckWaitDuration (54 symbols) and macMaxFrameRetries 7.4.2.
    """

    rate: Annotated[float, RATE, "of the air"] = 250e3
    phy_overhead: Annotated[int, Quantity("", ge=0, le=127), "bytes before the PSDU: preamble, delimiter, length"] = 6
    header: Annotated[int, Quantity("", ge=0, le=127), "bytes of the PSDU besides the payload: header, checksum"] = 11
    max_psdu: Annotated[int, Quantity("", ge=1, le=127), "bytes of the longest PSDU"] = 127
    turnaround: Annotated[float, SPAN, "between receiving and sending"] = 192e-6
    acks: Annotated[bool, "whether the receiver acknowledges a unicast"] = True
    ack_bytes: Annotated[int, Quantity("", ge=1, le=127), "bytes of an acknowledgement on the air"] = 11
    ack_wait: Annotated[float, TICK, "how long a sender waits for an acknowledgement"] = 864e-6
    max_retries: Annotated[int, Quantity("", ge=0, le=100), "how often a frame is sent again without one"] = 3
    sifs: Annotated[float, SPAN, "between a short frame and the sender's next"] = 192e-6
    lifs: Annotated[float, SPAN, "between a long frame and the sender's next"] = 640e-6
    sifs_bytes: Annotated[int, Quantity("", ge=0, le=127), "bytes of the largest PSDU that is short"] = 18

    @property
    def payload_bits(self) -> int:
        """How many bits the longest frame carries."""
        return (self.max_psdu - self.header) * 8

    @property
    def ack_bits(self) -> int:
        """Bits of an acknowledgement on the air."""
        return 8 * self.ack_bytes

    def bits(self, payload_bits: int) -> int:
        """On the air, of a frame with such a payload: whole bytes, what surrounds it included."""
        return 8 * (self.phy_overhead + self.header + ceil(payload_bits / 8))

    def airtime(self, bits: float) -> float:
        """Seconds that so many bits on the air take."""
        return bits / self.rate

    def spacing(self, bits: float) -> float:
        """Seconds that a sender waits after a frame of so many bits on the air: SIFS or LIFS, by its PSDU."""
        return self.sifs if bits / 8 - self.phy_overhead <= self.sifs_bytes else self.lifs

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Frames without room, a wait that no acknowledgement meets, a rate that is not the radio's."""
        yield from self._too_small(setup)
        needed = self.turnaround + self.airtime(self.ack_bits)
        if self.acks and self.ack_wait < needed:
            yield Issue(
                ("mac", "ack_wait"),
                f"{self.ack_wait:g} s is over before an acknowledgement of {self.ack_bytes} bytes at {self.rate:g} "
                f"bit/s has come: at least {needed:g} s are needed, or acks: false",
            )
        yield from _other_rate(self.rate, setup)

    def _too_small(self, setup: Setup) -> Iterator[Issue]:
        """A frame that cannot carry a payload at all, or not what the scenario sends in one piece."""
        if self.header >= self.max_psdu:
            yield Issue(
                ("mac", "header"),
                f"{self.header} bytes leave no payload in a PSDU of mac.max_psdu = {self.max_psdu} bytes",
            )
            return
        for path, bits, what in _pieces(setup):
            if bits > self.payload_bits:
                yield Issue(path, f"{what} of {bits} bits does not fit a frame, which carries {self.payload_bits} bits")


@part
class Csma(Framed):
    """Listen before sending, after a random backoff: unslotted CSMA/CA of IEEE 802.15.4.

    Wait a uniform number of 0 to 2^BE - 1 backoff periods, then listen for `cca`; where the channel is busy, BE grows
    by one up to `max_be`, and after `max_backoffs` more attempts the frame is given up.

    Source: IEEE 802.15.4-2006, 7.5.1.4; aUnitBackoffPeriod, macMinBE, macMaxBE, macMaxCSMABackoffs 7.4; CCA 6.9.9.
    """

    mechanism: ClassVar[str] = "csma"

    backoff: Annotated[float, TICK, "aUnitBackoffPeriod: one backoff period"] = 320e-6
    min_be: Annotated[int, Quantity("", ge=0, le=16), "macMinBE: first backoff exponent"] = 3
    max_be: Annotated[int, Quantity("", ge=0, le=16), "macMaxBE: largest backoff exponent"] = 5
    max_backoffs: Annotated[int, Quantity("", ge=0, le=100), "macMaxCSMABackoffs: attempts after the first"] = 4
    cca: Annotated[float, TICK, "how long the channel is listened to"] = 128e-6

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What `Framed` finds, and backoff exponents that shrink."""
        yield from Framed.check(self, setup)
        if self.min_be > self.max_be:
            yield Issue(("mac", "max_be"), f"{self.max_be} is less than mac.min_be = {self.min_be}")


@part
class Tdma(Csma):
    """Inside a cluster its head gives each member a slot; all that is sent outside a schedule contends as in `Csma`.

    The head broadcasts the schedule, `schedule_bits` an entry. Frames in slots need no acknowledgement (they cannot
    collide inside the cluster), so that `acks` is off.

    A slot begins and ends with a `guard` (our choice, 0.25 ms). Two clocks of ±90 ppm (three standard deviations of
    30 ppm) part by 0.18 ms in a second: the two guards between neighbouring frames hold them apart for 2.8 s after a
    schedule, 69 steps of Jiang's. A slot for a packet of 12 bytes takes 1.43 ms, so that such a step of 40 ms has room
    for 28. A member whose clock has run or jumped farther than a guard since it heard the schedule misses its slot.

    Source: LEACH, Heinzelman, Chandrakasan, Balakrishnan (2002), section III: set-up by CSMA, then TDMA in the cluster.
    """

    mechanism: ClassVar[str] = "tdma"

    acks: Annotated[bool, "whether the receiver acknowledges a unicast"] = False
    guard: Annotated[float, Quantity("s", ge=0.0, le=10.0), "silence at either end of a slot"] = 0.25e-3
    slot: Annotated[
        float | None,
        Quantity("s", ge=1e-6, le=1e3),
        "length of a slot; left out: what the longest frame of its round needs",
    ] = None
    schedule_bits: Annotated[int, Quantity("", ge=1, le=1000), "bits of one entry of the schedule"] = 16

    def slot_needed(self, bits: float) -> float:
        """Seconds of a slot for a frame of so many bits on the air: guards, airtime, acknowledgement if any."""
        answer = self.turnaround + self.airtime(self.ack_bits) if self.acks else 0.0
        return max(self.guard, self.turnaround) + self.airtime(bits) + answer + self.guard

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What `Csma` finds, and slots in which not even one packet of 12 bytes can be sent."""
        yield from Csma.check(self, setup)
        needed = self.slot_needed(self.bits(PACKET_BITS))
        if self.slot is not None and self.slot < needed:
            guards = f"its guards of {self.guard:g} s" + (" and its acknowledgement" if self.acks else "")
            yield Issue(
                ("mac", "slot"),
                f"{self.slot:g} s is too short for a packet of {PACKET_BITS} bits with {guards}: at least "
                f"{needed:g} s are needed; left out, slots are as long as they must be",
            )


def _pieces(setup: Setup) -> Iterator[tuple[tuple[str, ...], int, str]]:
    """What the scenario sends in one piece: the path that says so, its bits, and what it is."""
    if isinstance(setup, BeaconSetup):
        yield ("workload", "bits"), int(getattr(setup.workload, "bits", 0)), "a beacon"
    if isinstance(setup, NetworkSetup):
        yield ("mac", "max_psdu"), PACKET_BITS, "a packet"
        if setup.sink.point is not None:
            yield ("sink", "bits"), setup.sink.bits, "a report"


def _other_rate(rate: float, setup: Setup) -> Iterator[Issue]:
    """A radio, on whose datasheet the energy model rests, that has another rate."""
    radio = getattr(setup.energy, "radio", None) if isinstance(setup, RadioSetup) else None
    if radio is not None and radio.rate != rate:
        yield Issue(
            ("mac", "rate"), f"{rate:g} bit/s is not the rate of energy.radio ({radio.name}): {radio.rate:g} bit/s"
        )
