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


class Packing(Protocol):
    """How many packets of a burst travel in one frame."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """The number of packets of `packet_bits` in a frame whose payload holds `most_bits`; at least 1."""
