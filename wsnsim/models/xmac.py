"""X-MAC: the parameters of low-power listening with strobes that name the destination."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import floor
from typing import Annotated, ClassVar

from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import Latency, RadioDuty
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import Setup
from wsnsim.models.access import TICK
from wsnsim.models.low_power_listening import ROUNDING, SHORT, LowPowerListening


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

    strobe_bytes: Annotated[
        int, Quantity("", ge=1, le=133, label="byte"), "bytes of a strobe on the air: S_p is their airtime"
    ] = 17
    listen: Annotated[
        float | None,
        Quantity("s", ge=1e-6, le=10.0),
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
