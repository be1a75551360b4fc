"""The ports of medium access control: what a MAC component, and the packing of its frames, must offer."""

from __future__ import annotations

from typing import Protocol


class Mac(Protocol):
    """When a frame gets the channel: the parameters of a mechanism.

    `mechanism` names a built-in one. A plug-in gives it a name of its own, and starts it: see `StartsMac`.
    """

    @property
    def mechanism(self) -> str:
        """The name of the mechanism."""


class IdealAccess(Mac, Protocol):
    """An ideal channel."""

    @property
    def rate(self) -> float | None:
        """Bit/s on the air; None: sending takes no time."""


class FramedMac(Mac, Protocol):
    """A MAC whose frames take time."""

    @property
    def rate(self) -> float:
        """Bit/s on the air."""

    @property
    def turnaround(self) -> float:
        """Seconds between receiving and sending."""

    @property
    def acks(self) -> bool:
        """Whether unicasts are acknowledged."""

    @property
    def ack_wait(self) -> float:
        """Seconds for which a sender waits for an acknowledgement."""

    @property
    def max_retries(self) -> int:
        """How often a frame without acknowledgement is sent again."""

    @property
    def ack_bits(self) -> int:
        """Bits of an acknowledgement on the air."""

    @property
    def payload_bits(self) -> int:
        """Bits of the largest payload of a frame."""

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with this payload, preamble and headers included."""

    def airtime(self, bits: float) -> float:
        """Seconds that a frame of this length on the air takes."""

    def spacing(self, bits: int) -> float:
        """Seconds between the end of a frame of this length and the sender's next one."""


class ContendingMac(FramedMac, Protocol):
    """CSMA/CA.

    Attributes:
        backoff: Length of a backoff period in s.
        min_be: Initial backoff exponent BE: the wait is below 2^BE periods.
        max_be: Largest backoff exponent.
        max_backoffs: Attempts after the first before a frame is dropped.
        cca: Duration of a clear channel assessment in s.
    """

    backoff: float
    min_be: int
    max_be: int
    max_backoffs: int
    cca: float


class SlottedMac(ContendingMac, Protocol):
    """TDMA inside clusters, CSMA/CA elsewhere. `acks` is about unicasts in slots; those outside always have them.

    Attributes:
        guard: Silence at both ends of a slot, in s.
        slot: Length of a slot in s; None: as long as needed.
        schedule_bits: Bits of one entry in the schedule that the head broadcasts.
        contention: Shortest time between two rounds of a head, in s.
        idle_slots: 'skipped' or 'kept': whether a round leaves out the slots of members that have nothing to send.
    """

    guard: float
    slot: float | None
    schedule_bits: int
    contention: float
    idle_slots: str

    def slot_needed(self, bits: int) -> float:
        """Seconds of a slot for a frame of this length: turnaround, acknowledgement and guards included."""


class Packing(Protocol):
    """How many packets of a burst travel in one frame."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """The number of packets of `packet_bits` in a frame whose payload holds `most_bits`; at least 1."""
