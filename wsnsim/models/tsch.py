"""TSCH: the parameters of time-slotted channel hopping, and what they cost when nobody sends.

Defaults: IEEE 802.15.4-2015 at 2.4 GHz, and the minimal 6TiSCH configuration (RFC 8180).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from math import ceil
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import Latency, RadioDuty
from wsnsim.base.part import Quantity, part
from wsnsim.base.quiet import Hearing, RadioUse, Upkeep
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.access import Framed
from wsnsim.models.bounds import BACKOFF_EXPONENT, FRAME_BYTES, LONG_PERIOD, MANY, SPAN, TICK
from wsnsim.models.hardware import PerfectClock

HOPPING: Final = (16, 17, 23, 18, 26, 15, 25, 22, 19, 11, 12, 13, 24, 14, 20, 21)
"""The default hopping sequence of IEEE 802.15.4 for the 16 channels at 2.4 GHz."""
OFFSET: Final = Quantity("s", ge=1e-6, le=1.0)
MOST_CELLS: Final = 64
"""The largest number of cells, without the shared ones, in which a node receives (our choice)."""
LARGEST_DRIFT: Final = 6.0
"""Two clocks differ by at most this many standard deviations of the rate: each is truncated at three."""


@part
class Tsch(Framed):
    """Time-slotted channel hopping of IEEE 802.15.4: frames are sent in slots of a slotframe that repeats.

    Slots are counted from the start of the network (ASN, absolute slot number). A cell with channel offset c uses
    channel `channels[(ASN + c) mod n]` of n. All nodes listen in the `shared` cells, spread evenly over the slotframe;
    the first one is in slot 0. A node sends a frame in the next shared cell, without assessing the channel. After a
    failure it skips 0 to 2^BE - 1 shared cells, uniformly distributed; BE is `min_be` after the first failure of a
    frame and grows by one with each further one, up to `max_be`. Broadcasts are sent once.

    When members send to their cluster head, or a head to its members, and there are two frames or more, the head gives
    them cells of their own. It announces them in a shared cell, with `cell_bits` per cell. Cells are sampled uniformly
    from the slots in which the head has no other cell, with a random channel offset: those of two heads may collide.
    They are released when the last frame was acknowledged, and at the latest `lease` slotframes after the
    announcement. A node that did not receive the announcement uses the shared cells. These rules are ours; 6TiSCH
    negotiates cells pair by pair (6P, RFC 8480), which takes too long for a step of a tracker.

    A slot begins by the local clock of a node. A frame begins `tx_offset` later, and a receiver listens for `rx_wait`,
    centred on that: a frame that comes earlier or later by more than half of it is not received. Clocks with errors are
    corrected: see `network.radio.tsch.synchronisation`; without errors no frame is sent for that. Keep-alives and
    beacons take shared cells: n nodes in range of each other send n / `keep_alive_compensated` and n / `eb_period` a
    second. If that takes more than a third of the shared cells, more of them collide than arrive.

    Source: IEEE 802.15.4-2015, 6.2.5.3 (back-off), 6.2.6 and 6.5.4 (slots), 8.4.2.2.3 (timeslot template); RFC 8180,
    section 4: one shared cell, 3 retransmissions, example of 101 slots. min_be and max_be are those of the 6TiSCH
    simulator. Enhanced beacon: payload of RFC 8180, A.1; acknowledgement: 13 bytes with addresses and time correction.
    Neither frames nor acknowledgements are secured.
    """

    mechanism: ClassVar[str] = "tsch"
    in_symbols: ClassVar[tuple[str, ...]] = (
        *Framed.in_symbols, "slot", "tx_offset", "rx_wait", "tx_ack_delay", "rx_ack_delay",
    )  # fmt: skip
    off_key: ClassVar[str] = "slot"

    slotframe: Annotated[int, MANY, "slots in a slotframe"] = 101
    slot: Annotated[float, OFFSET, "macTsTimeslotLength: length of a slot"] = 10e-3
    shared: Annotated[int, MANY, "shared cells in a slotframe"] = 1
    channels: Annotated[
        tuple[int, ...], Quantity("", ge=11, le=26), "macHoppingSequence: the channels, in the order of hopping"
    ] = HOPPING
    min_be: Annotated[int, BACKOFF_EXPONENT, "macMinBE: back-off exponent after the first failure"] = 1
    max_be: Annotated[int, BACKOFF_EXPONENT, "macMaxBE: largest back-off exponent"] = 7
    tx_offset: Annotated[float, OFFSET, "macTsTxOffset: from the start of a slot to that of the frame"] = 2.12e-3
    rx_wait: Annotated[float, OFFSET, "macTsRxWait: how long a receiver waits for a frame to begin"] = 2.2e-3
    tx_ack_delay: Annotated[float, OFFSET, "macTsTxAckDelay: from a frame to its acknowledgement"] = 1e-3
    rx_ack_delay: Annotated[float, SPAN, "macTsRxAckDelay: from a frame until its sender listens"] = 0.8e-3
    ack_wait: Annotated[float, TICK, "macTsAckWait: how long a sender waits for an acknowledgement to begin"] = 0.4e-3
    ack_bytes: Annotated[int, FRAME_BYTES, "bytes of an acknowledgement on the air"] = 19
    cell_bits: Annotated[
        int, Quantity("", ge=1, le=800, label="bit"), "bits that announce a cell: slot, channel offset, node"
    ] = 48
    lease: Annotated[int, MANY, "slotframes after which a cell is taken back"] = 4
    eb_bytes: Annotated[int, Quantity("", ge=1, le=116, label="byte"), "bytes of the payload of an enhanced beacon"] = (
        30
    )
    eb_period: Annotated[
        float | None, LONG_PERIOD, "time between the enhanced beacons of a node, where clocks err; null: none"
    ] = 60.0
    keep_alive: Annotated[
        float | None,
        LONG_PERIOD,
        "time without correction after which a node asks its time parent, where clocks err; null: never",
    ] = 5.0
    keep_alive_compensated: Annotated[
        float | None, LONG_PERIOD, "the same once the rate of its clock is known; null: rates are not estimated"
    ] = 60.0
    tick: Annotated[float, SPAN, "resolution of time stamps"] = 1.0 / 32768.0

    @property
    def guard(self) -> float:
        """By how many seconds a frame may be early or late."""
        return self.rx_wait / 2.0

    @property
    def rx_offset(self) -> float:
        """Seconds from the start of a slot until a receiver listens (macTsRxOffset)."""
        return self.tx_offset - self.guard

    @property
    def shortest_off(self) -> float:
        """The shortest time in s between two cells, whether they are used or not, or until a frame begins."""
        after_frame = self.slot - self.slot_needed(self.bits(self.payload_bits)) + self.rx_offset
        return min(self.slot - self.rx_wait, after_frame, self.tx_offset)

    @property
    def interval(self) -> float:
        """Seconds of a slotframe."""
        return self.slotframe * self.slot

    @cached_property
    def shared_slots(self) -> tuple[int, ...]:
        """The slots of the shared cells, ascending."""
        return tuple(cell * self.slotframe // self.shared for cell in range(self.shared))

    @cached_property
    def duties(self) -> tuple[RadioDuty, ...]:
        """The duty cycle of a node that receives in the shared cells only, in one more, in two more, ..."""
        return tuple(
            RadioDuty(self.interval, float(cells), cells * self.rx_wait)
            for cells in range(self.shared, min(self.slotframe, self.shared + MOST_CELLS) + 1)
        )

    def slot_needed(self, bits: float) -> float:
        """Seconds of a slot for a frame of this length on the air, with its acknowledgement."""
        answer = self.tx_ack_delay + self.airtime(self.ack_bits) if self.acks else 0.0
        return self.tx_offset + self.airtime(bits) + answer

    def latency(self, bits: int) -> Latency:
        """The longest time of a payload of `bits` over one hop, without contention and retries.

        `unicast` and `broadcast` are in a shared cell; `granted` is the announcement of a cell in a shared one, and
        the unicast in that cell.
        """
        waiting = ceil(self.slotframe / self.shared) * self.slot
        on_air = self.tx_offset + self.airtime(self.bits(bits))
        exchange = self.slot_needed(self.bits(bits))
        return Latency(waiting + exchange, waiting + on_air, waiting + on_air + self.interval + exchange)

    def upkeep(self, setup: RadioSetup) -> tuple[Upkeep, ...]:
        """Beacons where clocks err. Keep-alives are sent beside them, as depends on who heard which beacon."""
        if isinstance(setup.clock, PerfectClock):
            return ()
        period = self.eb_period or self.keep_alive or self.interval
        return (Upkeep(8 * self.eb_bytes, period, 2.0 * period, steady=False),)

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a broadcast takes of its sender, and at the other end of each link, where no other is in its cell."""
        on_air = self.bits(bits)
        arrives = hearing.arrives(on_air)
        sender = RadioUse((self.frames(on_air),), listening=-self.rx_wait)
        heard = RadioUse(
            (self.frames(on_air, arrives),), listening=-self.guard * arrives, together=self.interval / self.shared
        )
        return sender, heard

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of `Framed`; and of channels, cells, the times in a slot, and drift beyond the guard."""
        yield from Framed.check(self, setup)
        yield from self._bad_channels()
        yield from self._bad_cells()
        yield from self._bad_times()
        yield from self._too_much_drift(setup)
        least = self.interval / self.shared
        if self.eb_period is not None and self.eb_period < least:
            yield Issue(
                ("mac", "eb_period"),
                f"{self.eb_period:g} s is over before the next shared cell: give at least {least:g} s, or null",
            )

    def _short_wait(self, otherwise: str) -> Iterator[Issue]:
        """Yield an issue if the acknowledgement begins when its sender does not listen."""
        until = self.rx_ack_delay + self.ack_wait
        if not max(self.rx_ack_delay, self.turnaround) <= self.tx_ack_delay <= until:
            yield Issue(
                ("mac", "tx_ack_delay"),
                f"{self.tx_ack_delay:g} s after a frame its sender does not listen for an acknowledgement: it does "
                f"from mac.rx_ack_delay = {self.rx_ack_delay:g} s on for mac.ack_wait = {self.ack_wait:g} s, and the "
                f"receiver needs mac.turnaround = {self.turnaround:g} s",
            )

    def _bad_channels(self) -> Iterator[Issue]:
        if not self.channels:
            yield Issue(("mac", "channels"), "no channel is left: give one or more of 11 to 26, or leave it out")
        twice = [channel for channel, count in Counter(self.channels).items() if count > 1]
        if twice:
            yield Issue(("mac", "channels"), f"channel {twice[0]} stands more than once: give each channel once")

    def _bad_cells(self) -> Iterator[Issue]:
        if self.shared > self.slotframe:
            yield Issue(
                ("mac", "shared"),
                f"{self.shared} shared cells are more than mac.slotframe = {self.slotframe} slots",
            )
        if self.min_be > self.max_be:
            yield Issue(("mac", "max_be"), f"{self.max_be} is less than mac.min_be = {self.min_be}")
        if self.cell_bits > self.payload_bits:
            yield Issue(
                ("mac", "cell_bits"), f"{self.cell_bits} bits do not fit a frame, which carries {self.payload_bits}"
            )
        if self.eb_bytes * 8 > self.payload_bits:
            yield Issue(("mac", "eb_bytes"), f"{self.eb_bytes} bytes do not fit a frame: {self.payload_bits // 8} do")

    def _bad_times(self) -> Iterator[Issue]:
        longest = self.bits(self.payload_bits)
        needed = self.slot_needed(longest)
        if self.slot < needed:
            yield Issue(
                ("mac", "slot"),
                f"{self.slot:g} s is too short for the longest frame of {longest // 8} bytes"
                f"{' and its acknowledgement' if self.acks else ''} at {self.rate:g} bit/s: at least {needed:g} s are "
                f"needed, or a smaller mac.max_psdu",
            )
        elif self.rx_wait > self.slot:
            yield Issue(("mac", "rx_wait"), f"a guard time of {self.rx_wait:g} s is longer than a slot")
        elif self.rx_offset < 0.0 or self.turnaround > self.tx_offset:
            least = max(self.guard, self.turnaround)
            yield Issue(
                ("mac", "tx_offset"),
                f"{self.tx_offset:g} s is too early: half of mac.rx_wait and mac.turnaround end {least:g} s after the "
                f"start of the slot",
            )

    def _too_much_drift(self, setup: Setup) -> Iterator[Issue]:
        drift = LARGEST_DRIFT * float(getattr(setup.clock, "sd", 0.0)) if isinstance(setup, RadioSetup) else 0.0
        name = "eb_period" if self.keep_alive is None else "keep_alive"
        period = self.eb_period if self.keep_alive is None else self.keep_alive
        if period is None or not drift:
            return
        if drift * period > self.guard:
            yield Issue(
                ("mac", name),
                f"in {period:g} s two clocks, each off by 3 standard deviations (clock.sd), drift apart by "
                f"{drift * period:.3g} s, more than half of mac.rx_wait, {self.guard:g} s: at most "
                f"{self.guard / drift:.3g} s are possible, or a larger rx_wait; with keep_alive and eb_period null, "
                f"only what nodes send each other corrects their clocks",
            )
        if self.keep_alive is None:
            return
        rate_error, longest = self.tick / self.keep_alive, self.keep_alive_compensated
        if longest is not None and rate_error * longest > self.guard:
            yield Issue(
                ("mac", "keep_alive_compensated"),
                f"the rate of a clock is known to mac.tick / mac.keep_alive = {rate_error:.3g}, and {longest:g} s "
                f"would make that {rate_error * longest:.3g} s, more than half of mac.rx_wait, {self.guard:g} s: at "
                f"most {self.guard / rate_error:.3g} s are possible",
            )
