"""Low-power listening: the parameters of X-MAC and ContikiMAC, whose radios are off most of the time.

A node turns its radio on once an interval, at a phase of its own, and hears whether somebody wants it. A sender repeats
something short until its destination is awake: X-MAC strobes that name the destination, ContikiMAC the data frame. Both
rest on the frame format of `access.Framed`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import ceil, floor, log2
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import Latency, RadioDuty, off_time
from wsnsim.base.part import Quantity, part
from wsnsim.base.quiet import Hearing, RadioUse
from wsnsim.base.setups import Setup
from wsnsim.models.access import Framed
from wsnsim.models.bounds import AIR_BYTES, REPEATS, TICK

INTERVAL: Final = Quantity("s", ge=1e-3, le=60.0)
SHORT: Final = Quantity("s", ge=0.0, le=1.0)
ROUNDING: Final = 1e-12
"""Rounding may change the number of periods in an interval by this."""
PHASES: Final = 4096
"""Phases of the wake-ups of a node over which what it hears of a broadcast is averaged."""


@part
class LowPowerListening(Framed):
    """What both protocols share: the wake interval, and how a sender gets the channel.

    A node with a frame waits for a random time below `first_backoff`, or for as long as its radio takes to turn off
    and on again if that is longer and the radio is off (our choice: the stop counts in any case). It listens for so
    long that it hears any train of strobes under way. If the channel is busy, it waits for a random time below
    `backoff` with the radio off, and listens again. After `max_backoffs` more attempts the frame is dropped. A frame
    without acknowledgement is sent again after such a wait, up to `max_retries` times. These waits are our choice:
    the papers leave them to the layer above. Contiki's CSMA layer also waits for times in the order of the wake
    interval; 10 ms is the initial back-off of TinyOS on a CC2420.
    """

    interval: Annotated[float, INTERVAL, "wake interval: from one wake-up of a node to the next"] = 0.125
    near: Annotated[
        float | None,
        INTERVAL,
        "wake interval of nodes that expect a target: `interval` divided by a power of two; left out: the same",
    ] = None
    first_backoff: Annotated[float, SHORT, "longest random wait before a sender first listens"] = 10e-3
    backoff: Annotated[
        float | None,
        Quantity("s", ge=0.0, le=60.0),
        "longest random wait after a busy channel or a missing acknowledgement; left out: one interval",
    ] = None
    max_backoffs: Annotated[int, REPEATS, "attempts after the first before a frame is dropped"] = 7

    @cached_property
    def congestion(self) -> float:
        """The longest random wait after a busy channel or a missing acknowledgement, in s."""
        return self.interval if self.backoff is None else self.backoff

    def wake_ups(self, first: float, last: float) -> Floats:
        """(P, W) s at which nodes of P phases wake from `first` to `last`; NaN for what comes after."""
        phases = first + self.interval * (np.arange(PHASES) + 0.5) / PHASES
        found = phases[:, None] + self.interval * np.arange(ceil((last - first) / self.interval))
        return np.where(found <= last, found, np.nan)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of `Framed`; also missing acknowledgements and a `near` that is no part of the interval."""
        yield from Framed.check(self, setup)
        if not self.acks:
            yield Issue(("mac", "acks"), "a sender must learn that its destination is awake: acks: true is needed")
        if self.near is not None:
            parts = self.interval / self.near
            halvings = max(round(log2(parts)), 0)
            if abs(parts - 2**halvings) > 1e-9 * parts:
                yield Issue(
                    ("mac", "near"),
                    f"{self.near:g} s is not mac.interval = {self.interval:g} s divided by a power of two "
                    f"(nearest: {self.interval / 2**halvings:g} s)",
                )

    def intervals(self) -> list[float]:
        """The wake intervals of a node: the usual one, and the one near a target if there is one."""
        return [self.interval] if self.near is None else [self.interval, self.near]

    def too_short(self, on: float, what: str, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for each interval that leaves no time between wake-ups of `on` seconds."""
        start = off_time(getattr(setup, "energy", None))
        for key, interval in zip(("interval", "near"), self.intervals(), strict=False):
            if interval <= on + start:
                turning_on = f" and turning the radio off and on ({start:g} s)" if start else ""
                yield Issue(
                    ("mac", key),
                    f"{interval:g} s is not longer than {what} of {on:g} s{turning_on}: the radio would never be off",
                )


@part
class XMac(LowPowerListening):
    """X-MAC: short strobes that name the destination, and early acknowledgements that end them.

    A node is off for R_s and listens for R_l in each interval R_l + R_s. A sender sends strobes of S_p seconds with
    gaps of S_al seconds between them, in which the destination may send its early acknowledgement. The data frame and
    its acknowledgement follow. S_al is `ack_wait` and one `turnaround` here.

    A node that hears a strobe for somebody else turns its radio off until its next wake-up. A node that has received
    data stays on for `linger` seconds for frames of further senders. A sender that finds the channel busy listens for
    R_l more. If it hears strobes to its own destination, it stays on, and sends its data without strobes, after a
    random wait, when the other frame has been acknowledged. A node with several frames for the same destination sends
    strobes for the first one only.

    R_l must be S_p + S_al + S_p or more, so that a node which wakes in the middle of a strobe hears the next one whole.
    That is the default. A radio that is turned off in the middle of a frame loses it.

    A broadcast has strobes for a whole interval, which say when the frame follows them. Who hears one turns the radio
    off until then, as in B-MAC+. The paper leaves broadcasts open; Contiki's X-MAC keeps receivers on instead, which
    costs each of them half an interval of listening.

    Source: Buettner, Yee, Anderson, Han (2006), sections 3 and 4. Countdown: Avvenuti, Corsini, Masci, Vecchio (2006),
    "Increasing the efficiency of preamble sampling protocols for wireless sensor networks". `linger` and the lengths of
    frames are our choice.
    """

    mechanism: ClassVar[str] = "xmac"
    in_symbols: ClassVar[tuple[str, ...]] = (*LowPowerListening.in_symbols, "cca")

    strobe_bytes: Annotated[int, AIR_BYTES, "bytes of a strobe on the air: S_p is their airtime"] = 17
    listen: Annotated[
        float | None,
        TICK,
        "R_l: how long a node listens at each wake-up; left out: as long as is needed to hear a strobe",
    ] = None
    linger: Annotated[float, SHORT, "how long a node stays on after data, for frames of further senders"] = 10e-3
    cca: Annotated[float, TICK, "duration of a clear channel assessment"] = 128e-6

    @property
    def strobe_bits(self) -> int:
        """Bits of a strobe on the air."""
        return 8 * self.strobe_bytes

    @cached_property
    def gap(self) -> float:
        """S_al: s between two strobes."""
        return self.ack_wait + self.turnaround

    @cached_property
    def period(self) -> float:
        """S_p + S_al: s from the start of a strobe to that of the next one."""
        return self.airtime(self.strobe_bits) + self.gap

    @cached_property
    def window(self) -> float:
        """R_l: s for which a node listens at each wake-up."""
        return self.needed if self.listen is None else self.listen

    @cached_property
    def needed(self) -> float:
        """The shortest R_l that hears a whole strobe of every train: S_p + S_al + S_p, in s."""
        return self.period + self.airtime(self.strobe_bits)

    @cached_property
    def assessment(self) -> float:
        """S for which a sender listens first: a gap between strobes, and a clear channel assessment."""
        return self.gap + self.cca

    @cached_property
    def strobes(self) -> int:
        """Strobes of a broadcast, and of a unicast that nobody answers: they start over more than one interval."""
        return floor(self.interval / self.period + ROUNDING) + 2

    @cached_property
    def duties(self) -> tuple[RadioDuty, ...]:
        """How often and how long the radio of a node is on that hears nothing: at the usual interval, and near."""
        return tuple(RadioDuty(interval, 1, self.window) for interval in self.intervals())

    def latency(self, bits: int) -> Latency:
        """Seconds that one hop of a payload takes at most, without contention and retries."""
        frame = self.airtime(self.bits(bits))
        answer = self.turnaround + self.airtime(self.ack_bits)
        begin = self.first_backoff + self.assessment + self.turnaround + (self.strobes - 1) * self.period
        unicast = begin + self.airtime(self.strobe_bits) + answer + self.turnaround + frame + answer
        return Latency(unicast, begin + self.period + frame)

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a broadcast takes of its sender, and at the other end of each link.

        A sender that is in a listening window needs no start, and does not pay for the rest of the window. A receiver
        that hears a strobe in a window closes it; it is held on for the frame.
        """
        on_air, in_window = self.bits(bits), self.window / self.interval
        train = self.strobes * self.period
        sender = RadioUse(
            frames=(self.frames(self.strobe_bits, self.strobes, held=True), self.frames(on_air, held=True)),
            held=self.assessment + train + self.turnaround + self.airtime(on_air),
            starts=1.0 - in_window, listening=-0.5 * in_window * self.window,
        )  # fmt: skip
        return sender, self._reception_use(on_air, hearing)

    def _reception_use(self, on_air: int, hearing: Hearing) -> RadioUse:
        """What a train and its frame take of a node that hears the strobes that begin at 0, `period`, ..."""
        strobe, longest = self.airtime(self.strobe_bits), self.airtime(self.bits(self.payload_bits))
        last = (self.strobes - 1) * self.period
        begin = self.wake_ups(strobe - self.window, last)
        first = np.ceil(np.maximum(begin, 0.0) / self.period - ROUNDING) * self.period
        open_for = begin + self.window - first
        whole = np.floor((np.minimum(open_for - strobe, last - first)) / self.period + ROUNDING) + 1.0
        waits = last - first[:, 0] + self.ack_wait
        early = waits < hearing.off_time
        lost, frame = 1.0 - hearing.arrives(self.strobe_bits), hearing.arrives(on_air)
        heard = _caught(whole, lost) * whole.shape[1]
        expects = _caught(np.nansum(whole, axis=1), lost)
        on = self.turnaround + frame * self.airtime(on_air) + (1.0 - frame) * (longest + self.turnaround)
        between = self.period - self.turnaround
        in_window = between / self.interval
        return RadioUse(
            frames=(self.frames(self.strobe_bits, heard), self.frames(on_air, expects * frame, held=True)),
            held=expects * (on + np.mean(waits * early)),
            starts=expects * (1.0 - np.mean(early) - in_window),
            listening=-np.nanmean(open_for) * heard - expects * in_window * (self.window - 0.5 * between),
        )  # fmt: skip

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues, also of a listening window that misses strobes, and of one or a CCA that fills the interval."""
        yield from LowPowerListening.check(self, setup)
        if self.window < self.needed * (1.0 - 1e-9):
            yield Issue(
                ("mac", "listen"),
                f"{self.window:g} s may fall between two strobes: a whole strobe is heard in {self.needed:g} s "
                f"(two strobes of {self.airtime(self.strobe_bits):g} s and the gap of {self.gap:g} s between them)",
            )
        on, what = max((self.window, "a listening window"), (self.assessment, "a gap between strobes and a CCA"))
        yield from self.too_short(on, what, setup)


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
        TICK,
        "t_d: from the start of an acknowledgement until it is detected; left out: its preamble and delimiter",
    ] = None
    shortest: Annotated[int, AIR_BYTES, "bytes of the shortest frame on the air: t_s"] = 28
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

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a broadcast takes of its sender, and at the other end of each link.

        A receiver is woken by the first of its assessments that ends during a copy. If the assessment began before the
        copy, it receives that; otherwise it listens to its end, and receives the next one, or hears silence.
        """
        on_air = self.bits(bits)
        copies, period, airtime = self.copies(on_air), self.period(on_air), self.airtime(on_air)
        train = copies * period
        sender = RadioUse((self.frames(on_air, copies, held=True),), self.assessment + train, starts=1.0)
        begin = self.wake_ups(-self.assessment, train)
        ends = np.stack([begin + self.cca, begin + self.assessment])
        hits = (ends >= 0.0) & (ends % period < airtime) & (ends < train)
        first = hits[0]
        hit, end = hits.any(axis=0), np.where(first, ends[0], ends[1])
        since, is_last = end % period, end >= train - period
        whole = hit & (since <= self.cca)
        waits = hit & ~whole
        listening = np.where(whole, -since, airtime - since) * hit - self.cca * first
        held = waits * (self.frame_gap + np.where(is_last, self.cca, airtime))
        heard, senses = _mean(waits & ~is_last), hearing.senses
        arrives = senses * hearing.arrives(on_air)
        receiver = RadioUse(
            (self.frames(on_air, _mean(whole) * arrives), self.frames(on_air, heard * arrives, held=True)),
            held=_mean(held) * senses, starts=-_mean(first) * senses, listening=_mean(listening) * senses,
        )  # fmt: skip
        return sender, receiver

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


def _mean(of_wake_ups: Floats) -> float:
    """The mean over phases of a sum over wake-ups (P, W); NaN are left out."""
    return float(np.nansum(of_wake_ups, axis=1).mean())


def _caught(counts: Floats, lost: Floats) -> Floats:
    """(E,) the probability, over the counts, that of as many frames one arrives; `lost` (E,): that one does not."""
    numbers, times = np.unique(counts[np.isfinite(counts)], return_counts=True)
    return (1.0 - lost[:, None] ** numbers) @ (times / counts.size)
