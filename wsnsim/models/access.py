"""Medium access control: the parameters of the built-in MACs, and the format of their frames.

    bits(payload bits) -> bits on the air    airtime(bits) -> s    spacing(bits) -> s between a sender's frames

Defaults: IEEE 802.15.4-2006 at 2.4 GHz, 62.5 ksymbol/s, two symbols per byte (a symbol is 16 µs).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, inf
from typing import Annotated, ClassVar, Literal

from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import Latency, off_time
from wsnsim.base.part import Quantity, part
from wsnsim.base.quiet import Hearing, OfLinks, RadioUse, SentFrames, Upkeep
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import BeaconSetup, NetworkSetup, RadioSetup, Setup
from wsnsim.models.bounds import BACKOFF_EXPONENT, BIT_RATE, BYTES, FRAME_BYTES, REPEATS, SPAN, TICK


@part
class IdealMac:
    """The ideal channel: no contention and no collisions. Frames arrive at once, or after their airtime with a `rate`.

    Only the bits of the payload cost energy. With a rate, a node hears what ends while it listens, even if it woke in
    the middle. Source: Jiang, Song, Lin (2013); the rate and whom it reaches are ours.
    """

    mechanism: ClassVar[str] = "ideal"

    rate: Annotated[
        float | None, Quantity("bit/s", ge=1e-3), "bit rate on the air; left out: sending takes no time"
    ] = None

    def upkeep(self, setup: RadioSetup) -> tuple[Upkeep, ...]:
        """Nothing: nodes that have nothing to send are silent."""
        return ()

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a broadcast takes of its sender, and at the other end of each link."""
        seconds = 0.0 if self.rate is None else bits / self.rate
        heard = SentFrames(bits, seconds, hearing.arrives(PACKET_BITS))
        return RadioUse((SentFrames(bits, seconds),)), RadioUse((heard,))

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the rate differs from that of the radio."""
        if self.rate is not None:
            yield from _other_rate(self.rate, setup)


@part
class Framed:
    """What every MAC with frames shares: the format of a frame, its airtime, its acknowledgement and its spacing.

    A frame consists of the PHY's preamble, delimiter and length, and the PSDU: header, payload, check sequence. The
    receiver acknowledges a unicast without contention, after the turnaround. A broadcast is never acknowledged.

    Source: IEEE 802.15.4-2006: PHY overhead 6.3; aMaxPHYPacketSize and aTurnaroundTime 6.4.1; header with short
    addresses and one PAN id, checksum 7.2.1; acknowledgement 7.2.2.3; SIFS, LIFS and aMaxSIFSFrameSize 7.5.1.3;
    macAckWaitDuration (54 symbols) and macMaxFrameRetries 7.4.2.
    """

    in_symbols: ClassVar[tuple[str, ...]] = ("ack_wait", "sifs", "lifs")
    """Durations that are a number of symbols: with a datasheet of another rate, their defaults are as many there."""
    off_key: ClassVar[str] = ""
    """The parameter that says for how long radios are off: see `shortest_off`."""

    rate: Annotated[float, BIT_RATE, "bit rate on the air"] = 250e3
    phy_overhead: Annotated[int, BYTES, "bytes before the PSDU: preamble, delimiter, length"] = 6
    header: Annotated[int, BYTES, "bytes of the PSDU without its payload: header and check sequence"] = 11
    max_psdu: Annotated[int, FRAME_BYTES, "bytes of the longest PSDU"] = 127
    turnaround: Annotated[float, SPAN, "time between receiving and sending"] = 192e-6
    acks: Annotated[bool, "whether the receiver acknowledges a unicast"] = True
    ack_bytes: Annotated[int, FRAME_BYTES, "bytes of an acknowledgement on the air"] = 11
    ack_wait: Annotated[float, TICK, "how long a sender waits for an acknowledgement"] = 864e-6
    max_retries: Annotated[int, REPEATS, "how often a frame is sent again without an acknowledgement"] = 3
    sifs: Annotated[float, SPAN, "spacing between a short frame and the sender's next one"] = 192e-6
    lifs: Annotated[float, SPAN, "spacing between a long frame and the sender's next one"] = 640e-6
    sifs_bytes: Annotated[int, BYTES, "bytes of the largest PSDU of a short frame"] = 18

    @property
    def shortest_off(self) -> float:
        """The shortest time in s for which radios are off between two uses that are planned; infinity: never."""
        return inf

    @property
    def payload_bits(self) -> int:
        """Bits of the largest payload of a frame."""
        return (self.max_psdu - self.header) * 8

    @property
    def ack_bits(self) -> int:
        """Bits of an acknowledgement on the air."""
        return 8 * self.ack_bytes

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with this payload, in whole bytes, preamble and headers included."""
        return 8 * (self.phy_overhead + self.header + ceil(payload_bits / 8))

    def airtime(self, bits: float) -> float:
        """Seconds that a frame of this length on the air takes."""
        return bits / self.rate

    def spacing(self, bits: float) -> float:
        """Seconds that a sender waits after a frame of this length on the air: SIFS or LIFS, by its PSDU."""
        return self.sifs if bits / 8 - self.phy_overhead <= self.sifs_bytes else self.lifs

    def upkeep(self, setup: RadioSetup) -> tuple[Upkeep, ...]:
        """Nothing: nodes that have nothing to send are silent."""
        return ()

    def frames(self, on_air: int, number: OfLinks = 1.0, held: bool = False) -> SentFrames:
        """Frames of this length on the air."""
        return SentFrames(on_air, self.airtime(on_air), number, held)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues: frames too small, too short a wait for acknowledgements, a rate that is not the radio's."""
        yield from self._too_small(setup)
        if self.acks:
            yield from self._short_wait("or acks: false")
        yield from _other_rate(self.rate, setup)
        yield from self._slow_radio(setup)

    def _slow_radio(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the radio would have to be on again before it can be."""
        energy = getattr(setup, "energy", None)
        state, least = getattr(energy, "off_state", None), off_time(energy)
        if 0.0 <= self.shortest_off < least:
            yield Issue(
                ("energy", "off_state") if state else ("mac", self.off_key),
                f"radios would be off for {self.shortest_off:g} s at a time, and to turn off and on again takes "
                f"{least:g} s{f' from {state}' if state else ''}: choose an off_state that is left sooner, or a "
                f"longer mac.{self.off_key}",
            )

    def _short_wait(self, otherwise: str) -> Iterator[Issue]:
        """Yield an issue if an acknowledgement arrives after the wait for it."""
        needed = self.turnaround + self.airtime(self.ack_bits)
        if self.ack_wait < needed:
            yield Issue(
                ("mac", "ack_wait"),
                f"{self.ack_wait:g} s is over before an acknowledgement of {self.ack_bytes} bytes at {self.rate:g} "
                f"bit/s has arrived: at least {needed:g} s are needed, {otherwise}",
            )

    def _too_small(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues: a frame that cannot carry any payload, or not what the scenario sends in one frame."""
        if self.header >= self.max_psdu:
            yield Issue(
                ("mac", "header"),
                f"{self.header} bytes leave no payload in a PSDU of mac.max_psdu = {self.max_psdu} bytes",
            )
            return
        for path, bits, what in _unfragmented(setup):
            if bits > self.payload_bits:
                yield Issue(path, f"{what} of {bits} bits does not fit a frame, which carries {self.payload_bits} bits")


@part
class Csma(Framed):
    """Unslotted CSMA/CA of IEEE 802.15.4: a node listens before it sends, after a random backoff.

    It waits for 0 to 2^BE - 1 backoff periods, uniformly distributed, and then listens for `cca`. If the channel is
    busy, BE grows by one up to `max_be`. After `max_backoffs` more attempts the frame is dropped.

    Source: IEEE 802.15.4-2006, 7.5.1.4; aUnitBackoffPeriod, macMinBE, macMaxBE, macMaxCSMABackoffs 7.4; CCA 6.9.9.
    """

    mechanism: ClassVar[str] = "csma"
    in_symbols: ClassVar[tuple[str, ...]] = (*Framed.in_symbols, "backoff", "cca")

    backoff: Annotated[float, TICK, "aUnitBackoffPeriod: one backoff period"] = 320e-6
    min_be: Annotated[int, BACKOFF_EXPONENT, "macMinBE: first backoff exponent"] = 3
    max_be: Annotated[int, BACKOFF_EXPONENT, "macMaxBE: largest backoff exponent"] = 5
    max_backoffs: Annotated[int, REPEATS, "macMaxCSMABackoffs: attempts after the first"] = 4
    cca: Annotated[float, TICK, "duration of a clear channel assessment"] = 128e-6

    def latency(self, bits: int) -> Latency:
        """The latency of a payload of `bits`: the longest first backoff, the frame, and its acknowledgement."""
        waits = (2**self.min_be - 1) * self.backoff + self.cca
        sent = waits + self.turnaround + self.airtime(self.bits(bits))
        return Latency(sent + self.turnaround + self.airtime(self.ack_bits), sent)

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a broadcast takes of its sender, and at the other end of each link."""
        on_air = self.bits(bits)
        return RadioUse((self.frames(on_air),)), RadioUse((self.frames(on_air, hearing.arrives(on_air)),))

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of `Framed`, and one if the backoff exponents decrease."""
        yield from Framed.check(self, setup)
        if self.min_be > self.max_be:
            yield Issue(("mac", "max_be"), f"{self.max_be} is less than mac.min_be = {self.min_be}")


@part
class Tdma(Csma):
    """TDMA inside clusters, with slots given by the head; frames outside a schedule use CSMA/CA, as in `Csma`.

    The head broadcasts the schedule, with `schedule_bits` per entry. Frames in slots cannot collide inside the cluster
    and are not acknowledged by default. Frames outside slots (joins, handovers, relayed datagrams) are always
    acknowledged. With each retransmission BE grows, too, so that the many joins that answer one announcement spread:
    hence the largest `max_be` and `max_retries` of the standard. A node in range of the head or of a member with a slot
    holds such frames back until the round has ended. Rounds of one head are `contention` apart, so that these frames
    get their turn; the default is aMinCAPLength, 440 symbols. These rules are ours.

    A slot begins and ends with a `guard` (our choice, 0.25 ms). Two clocks of ±90 ppm (three standard deviations of
    30 ppm) differ by 0.18 ms after one second, so that the two guards between neighbouring frames suffice for 2.8 s
    after a schedule: 69 steps of Jiang's. A slot for a packet of 12 bytes takes 1.43 ms, so that a step of 40 ms has
    room for 28 of them. A member whose clock has drifted or jumped by more than a guard since it received the schedule
    misses its slot.

    With `idle_slots: kept` a round has one slot for each member of the schedule, in the order of node numbers that the
    head announced: all members whom it appointed or whose joins it received, or those alone that its tracker expects to
    send (`Gather.expected`: the plan of `information_driven`). It is over when the last slot is, whether anybody has
    sent or not, and the head listens all the time. A member sends one frame in a round; further frames, and those that
    were not acknowledged, go into further rounds of the same length. A schedule replaces the one before. It is
    announced when a member that it expects has no slot, more than half of the slots would be idle, or a member without
    a slot has sent.

    A member with something to send that has no slot, or did not receive the schedule, sends after the round by
    CSMA/CA, acknowledged, and has a slot in the next schedule once its frame has arrived. The head listens after the
    last slot for as long as a frame takes at most without contention, whether one comes or not, and for frames under
    way. If the schedule has all its members it goes on at once: then such a frame is late.
    `information_driven`, its deadline left out, waits for a round with all members (`Scene.hop_seconds`).

    With `idle_slots: skipped`, an idealisation, only frames take time: all nodes know who has nothing to send, those
    with later slots move up, and the head knows who lacks a schedule.

    Source: LEACH, Heinzelman, Chandrakasan, Balakrishnan (2002), section III: set-up by CSMA, then TDMA in the cluster.
    Contention period: IEEE 802.15.4-2006, 5.5.1; aMinCAPLength 7.4.1; macMaxBE and macMaxFrameRetries 7.4.2.
    """

    mechanism: ClassVar[str] = "tdma"
    in_symbols: ClassVar[tuple[str, ...]] = (*Csma.in_symbols, "contention")
    off_key: ClassVar[str] = "slot"

    acks: Annotated[bool, "whether the receiver acknowledges a unicast in a slot; outside slots it always does"] = False
    max_be: Annotated[int, BACKOFF_EXPONENT, "largest backoff exponent"] = 8
    max_retries: Annotated[int, REPEATS, "how often a frame is sent again without an acknowledgement"] = 7
    guard: Annotated[float, SPAN, "silence at both ends of a slot"] = 0.25e-3
    slot: Annotated[
        float | None,
        Quantity("s", ge=1e-6, le=1e3),
        "length of a slot; left out: as long as the longest frame of its round needs",
    ] = None
    schedule_bits: Annotated[int, Quantity("", ge=1, le=1000, label="bit"), "bits of one entry of the schedule"] = 16
    contention: Annotated[float, SPAN, "shortest time between two rounds of slots, in which other frames contend"] = (
        7.04e-3
    )
    idle_slots: Annotated[
        Literal["skipped", "kept"],
        "slots of members with nothing to send: left out as if all knew it (an idealisation), or as long as others",
    ] = "kept"

    @property
    def shortest_off(self) -> float:
        """The slot of another member, in s."""
        return self.slot_needed(self.bits(PACKET_BITS)) if self.slot is None else self.slot

    def turns(self, members: int) -> float:
        """Seconds of a schedule and a round with a slot for each of this number of members; 0: slots are skipped."""
        if self.idle_slots == "skipped":
            return 0.0
        return self.latency(PACKET_BITS).broadcast + members * self.shortest_off

    def slot_needed(self, bits: float) -> float:
        """Seconds of a slot for a frame of this length on the air: guards, airtime, acknowledgement if any."""
        answer = self.turnaround + self.airtime(self.ack_bits) if self.acks else 0.0
        return max(self.guard, self.turnaround) + self.airtime(bits) + answer + self.guard

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of `Csma`, and one if a slot is too short for a packet of 12 bytes."""
        yield from Csma.check(self, setup)
        if not self.acks:
            yield from self._short_wait("as frames outside slots are acknowledged")
        needed = self.slot_needed(self.bits(PACKET_BITS))
        if self.slot is not None and self.slot < needed:
            guards = f"its guards of {self.guard:g} s" + (" and its acknowledgement" if self.acks else "")
            yield Issue(
                ("mac", "slot"),
                f"{self.slot:g} s is too short for a packet of {PACKET_BITS} bits with {guards}: at least "
                f"{needed:g} s are needed; left out, slots are as long as needed",
            )
        if self.idle_slots == "kept" and isinstance(setup, NetworkSetup):
            yield from self._round_too_long(setup, self.shortest_off)

    def _round_too_long(self, setup: NetworkSetup, slot: float) -> Iterator[Issue]:
        """Yield an issue if kept slots leave a step no time, or if heads gather one packet after the other."""
        if slot + self.contention >= setup.dt:
            yield Issue(
                ("mac", "idle_slots"),
                f"a round of one slot of {slot:g} s and mac.contention = {self.contention:g} s are longer than a "
                f"step of {setup.dt:g} s: give a longer step, a shorter slot or contention, or idle_slots: skipped",
            )
        if setup.head_protocol == "moving":
            yield Issue(
                ("mac", "idle_slots"),
                "heads that move gather each packet by itself, and each would wait for a whole round: give "
                "idle_slots: skipped, or other clusters",
            )


def _unfragmented(setup: Setup) -> Iterator[tuple[tuple[str, ...], int, str]]:
    """Yield (key, bits, description) of what the scenario sends in one frame."""
    if isinstance(setup, BeaconSetup):
        what = "a beacon" if setup.workload.mechanism == "beacons" else "a report"
        yield ("workload", "bits"), int(getattr(setup.workload, "bits", 0)), what
    if isinstance(setup, NetworkSetup):
        yield ("mac", "max_psdu"), PACKET_BITS, "a packet"
        if setup.sink.point is not None:
            yield ("sink", "bits"), setup.sink.bits, "a report"


def _other_rate(rate: float, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if the rate differs from that of the radio in the energy model."""
    radio = getattr(setup.energy, "radio", None) if isinstance(setup, RadioSetup) else None
    if radio is not None and radio.rate != rate:
        yield Issue(
            ("mac", "rate"), f"{rate:g} bit/s is not the rate of energy.radio ({radio.name}): {radio.rate:g} bit/s"
        )
