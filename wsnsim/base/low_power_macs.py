"""The ports of MACs with low-power listening: what X-MAC and ContikiMAC tell their mechanisms. Times in s."""

from __future__ import annotations

from typing import Protocol

from wsnsim.base.medium_access import FramedMac


class LowPowerMac(FramedMac, Protocol):
    """A MAC whose nodes listen once an interval.

    Attributes:
        interval: Wake interval.
        near: Wake interval of nodes that expect a target; None: the same.
        first_backoff: The longest random wait before a sender first listens.
        max_backoffs: Attempts after the first before a frame is dropped.
        linger: How long a receiver stays on for further frames.
    """

    interval: float
    near: float | None
    first_backoff: float
    max_backoffs: int
    linger: float

    @property
    def congestion(self) -> float:
        """The longest random wait after a busy channel or a missing acknowledgement."""

    @property
    def assessment(self) -> float:
        """For how long a sender listens first."""


class StrobingMac(LowPowerMac, Protocol):
    """X-MAC."""

    @property
    def strobe_bits(self) -> int:
        """Bits of a strobe on the air."""

    @property
    def gap(self) -> float:
        """S_al: between two strobes."""

    @property
    def period(self) -> float:
        """S_p + S_al: from the start of a strobe to that of the next one."""

    @property
    def window(self) -> float:
        """R_l: how long a node listens at each wake-up."""

    @property
    def strobes(self) -> int:
        """Strobes of a broadcast, and of a unicast that nobody answers."""


class RepeatingMac(LowPowerMac, Protocol):
    """ContikiMAC.

    Attributes:
        cca: t_r: duration of a clear channel assessment.
        cca_gap: t_c: between the two assessments of a wake-up.
        frame_gap: t_i: between two copies of a frame.
        phase_lock: Whether senders learn when their destinations wake.
        guard: How long before a known wake-up a sender begins.
    """

    cca: float
    cca_gap: float
    frame_gap: float
    phase_lock: bool
    guard: float

    @property
    def longest(self) -> float:
        """Airtime of the longest frame."""

    def period(self, bits: int) -> float:
        """From the start of one copy of a frame to that of the next one."""

    def copies(self, bits: int) -> int:
        """Copies of a broadcast, and of a unicast that nobody acknowledges."""
