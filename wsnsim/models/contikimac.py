"""ContikiMAC: the parameters of low-power listening with repeated data frames and phase lock."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import ceil, floor
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import Latency, RadioDuty
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import Setup
from wsnsim.models.access import TICK
from wsnsim.models.low_power_listening import ROUNDING, SHORT, LowPowerListening

SYNCHRONISATION_BITS: Final = 40
"""Preamble and delimiter of a frame."""


@part
class ContikiMac(LowPowerListening):
    """ContikiMAC: two clear channel assessments a wake-up; the data frame itself is repeated until it is acknowledged.

    At a wake-up a node assesses the channel for t_r (`cca`), pauses for t_c (`cca_gap`) and assesses it again. If the
    channel is busy at the end of either, it stays on for the next copy of the frame. Copies are t_i (`frame_gap`)
    apart. A receiver sends its acknowledgement after t_a (`turnaround`), and a sender has detected it t_d
    (`detection`) later. With t_s the airtime of the shortest frame, t_a + t_d < t_i < t_c < t_c + 2 t_r < t_s must
    hold: then no assessment misses a train, and no copy disturbs an acknowledgement. Shorter frames are padded to
    `shortest` bytes on the air.

    Fast sleep: a node that stays on for a frame turns the radio off if the channel is busy for longer than the longest
    frame takes, if it is silent for longer than t_i, or if what follows the silence is no frame that it can receive.

    Phase lock (`phase_lock`): an acknowledgement tells the sender when its destination wakes. It sends the next frame
    from `guard` seconds, and a random time below `guard`, before the next such instant on (the random time is ours: two
    senders that know the same destination would begin together). If no acknowledgement comes until `guard` seconds
    after it, the sender forgets the phase, and the retry takes a whole interval. Broadcasts take a whole interval.

    While a sender has another frame for the same destination, it says so in the frame: the receiver then stays on for
    up to `linger` seconds, and the next frame follows at once.

    Between the two assessments the radio is off for t_c. A CC2420 in power-down needs 1.1 ms to turn off and on again:
    with the default t_c it stays in idle mode, as under Contiki, whose driver leaves crystal and regulator on. With
    `cca_gap: 1.2 ms` and `shortest: 50` it is in power-down.

    Source: Dunkels (2011), "The ContikiMAC radio duty cycling protocol", SICS T2011:13, sections 2 and 3; `linger` and
    the values of t_r, t_c and t_i as in Contiki 2.5 and its report. That an assessment hears what is on the air at its
    end, that a sender listens for t_c + 2 t_r without a pause before it sends, and `guard` are our choice (Contiki has
    12 ms).
    """

    mechanism: ClassVar[str] = "contikimac"
    in_symbols: ClassVar[tuple[str, ...]] = (*LowPowerListening.in_symbols, "cca", "cca_gap", "frame_gap")
    off_key: ClassVar[str] = "cca_gap"

    cca: Annotated[float, TICK, "t_r: duration of a clear channel assessment"] = 192e-6
    cca_gap: Annotated[float, TICK, "t_c: between the two assessments of a wake-up"] = 500e-6
    frame_gap: Annotated[float, TICK, "t_i: between two copies of a frame"] = 400e-6
    detection: Annotated[
        float | None,
        Quantity("s", ge=1e-6, le=10.0),
        "t_d: from the start of an acknowledgement until it is detected; left out: its preamble and delimiter",
    ] = None
    shortest: Annotated[
        int, Quantity("", ge=1, le=133, label="byte"), "bytes of the shortest frame on the air: t_s"
    ] = 28
    phase_lock: Annotated[bool, "whether senders learn when their destinations wake"] = True
    guard: Annotated[float, Quantity("s", ge=0.0, le=1.0), "how long before a known wake-up a sender begins"] = 2e-3
    linger: Annotated[float, SHORT, "how long a receiver waits for a further frame that was announced"] = 31.25e-3

    @property
    def shortest_off(self) -> float:
        """The pause between two assessments, in s."""
        return self.cca_gap

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with this payload, padded to the shortest frame."""
        return max(8 * (self.phy_overhead + self.header + ceil(payload_bits / 8)), 8 * self.shortest)

    @cached_property
    def assessment(self) -> float:
        """S for which a sender listens first."""
        return self.cca_gap + 2.0 * self.cca

    @cached_property
    def longest(self) -> float:
        """Airtime of the longest frame, in s."""
        return self.airtime(8 * (self.phy_overhead + self.max_psdu))

    def period(self, bits: int) -> float:
        """S from the start of one copy of a frame of this length on the air to that of the next one."""
        return self.airtime(bits) + self.frame_gap

    def copies(self, bits: int) -> int:
        """Copies of a broadcast, and of a unicast that nobody acknowledges: they start over more than one interval."""
        return floor(self.interval / self.period(bits) + ROUNDING) + 2

    @cached_property
    def duties(self) -> tuple[RadioDuty, ...]:
        """How often and how long the radio of a node is on that hears nothing: at the usual interval, and near."""
        return tuple(RadioDuty(interval, 2, 2.0 * self.cca) for interval in self.intervals())

    def latency(self, bits: int) -> Latency:
        """Seconds that one hop of a payload takes at most, without contention, retries and phase lock."""
        on_air = self.bits(bits)
        train = (self.copies(on_air) - 1) * self.period(on_air) + self.airtime(on_air)
        broadcast = self.first_backoff + self.assessment + self.turnaround + train
        return Latency(broadcast + self.turnaround + self.airtime(self.ack_bits), broadcast)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues, also of timings that violate the inequality of the protocol."""
        yield from LowPowerListening.check(self, setup)
        short = list(self.too_short(self.assessment, "a wake-up", setup))
        yield from short or self._timings()

    def _timings(self) -> Iterator[Issue]:
        """Yield issues of timings that fit the wake interval, but not each other."""
        yield from self._order()
        if self.shortest > self.phy_overhead + self.max_psdu:
            yield Issue(
                ("mac", "shortest"),
                f"{self.shortest} bytes do not fit a frame, which has {self.phy_overhead + self.max_psdu} on the air",
            )
        if self.phase_lock and self.guard >= self.interval / 4.0:
            yield Issue(
                ("mac", "guard"),
                f"{self.guard:g} s is a quarter of mac.interval = {self.interval:g} s or more: a known phase saves "
                "nothing; shorten it, or phase_lock: false",
            )

    def _order(self) -> Iterator[Issue]:
        """Yield an issue for each part of t_a + t_d < t_i < t_c < t_c + 2 t_r < t_s that does not hold."""
        shortest = self.airtime(8 * self.shortest)
        detection = self.airtime(SYNCHRONISATION_BITS) if self.detection is None else self.detection
        answer, channel_check = self.turnaround + detection, self.assessment
        order = (
            ("frame_gap", "t_i", self.frame_gap, answer, "t_a + t_d (turnaround and detection)", "acknowledgements"),
            ("cca_gap", "t_c", self.cca_gap, self.frame_gap, "t_i (frame_gap)", "trains whose gap it falls into"),
            ("shortest", "t_s", shortest, channel_check, "t_c + 2 t_r (cca_gap and two cca)", "short frames"),
        )
        for key, symbol, value, least, what, missed in order:
            if not value > least:
                more = self._advice(floor(least * self.rate / 8.0 + 1e-9) + 1) if key == "shortest" else ""
                yield Issue(
                    ("mac", key),
                    f"{symbol} = {value:g} s must be longer than {what} = {least:g} s, or nodes miss {missed}{more}",
                )

    def _advice(self, shortest: int) -> str:
        """What to do where frames would have to have this many bytes on the air."""
        longest = self.phy_overhead + self.max_psdu
        if shortest <= longest:
            return f"; {shortest} bytes suffice"
        return f"; no frame is so long (at most {longest} bytes on the air): shorten cca_gap or cca"
