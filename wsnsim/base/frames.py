"""Bursts, MAC frames, and the counters of a run's frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import nan
from typing import Any, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.tables import KIND


@dataclass(slots=True)
class Counters:
    """Totals of one run, over all nodes.

    Attributes:
        transmissions: MAC frames on the air, acknowledgements included. The other counters leave those out.
        frames_sent: Frames sent; on an ideal channel, bursts.
        frames_lost: Of these, frames that did not reach every node that they were meant for.
        packets_sent: Packets in the frames sent.
        in_range: Receptions that were intended: one per frame and node that it was meant for.
        delivered: Of these, receptions that succeeded.
        collided: Of these, receptions lost because another transmission overlapped.
        access_failures: Frames dropped because the channel was busy at every assessment.
        retries: Frames sent again because no acknowledgement came.
    """

    transmissions: int = 0
    frames_sent: int = 0
    frames_lost: int = 0
    packets_sent: int = 0
    in_range: int = 0
    delivered: int = 0
    collided: int = 0
    access_failures: int = 0
    retries: int = 0


EVERYONE: Final = -1
"""Destination of a broadcast."""
SEND: Final = KIND["send"]

Received = Any
"""Result of a frame: for a broadcast the ids (n,) that received it, for a unicast whether its destination did."""


@dataclass(slots=True)
class Burst:
    """The packets of one parcel over one hop. The MAC writes into it what arrived.

    Attributes:
        source: The sender.
        to: The destination, or EVERYONE.
        parcel: What is sent.
        target: The target that it is about; -1 for none.
        mask: (packets,) which packets of the parcel are in the burst; afterwards, for a unicast, which of them arrived.
        packets: The number of these packets.
        sequence: Number of the datagram or message, the same over all hops; 0 before the first hop.
        relayed: Whether the sender is not the origin.
        sent: Bits that left the sender.
        attempts: How often the MAC tried to send its frames, retransmissions included; 0 if it never got the channel. A
            train of strobes, or of copies of a frame, is one attempt. Set when the burst ends.
        acknowledged: For a unicast that has ended, whether its sender knows that a frame of it arrived. Where the MAC
            does not say, whether one did.
        received: For a broadcast, {node: (packets,) which packets it received}.
        heard: For a unicast under way, (packets,) which packets have arrived so far; None: none, or the MAC does not
            say it before the end.
        heard_at: When the last of them arrived, in s.
    """

    source: int
    to: int
    parcel: Parcel
    target: int
    mask: Bools
    packets: int
    sequence: int = 0
    relayed: bool = False
    sent: int = 0
    attempts: int = 0
    acknowledged: bool = False
    received: dict[int, Bools] = field(default_factory=dict)
    heard: Bools | None = None
    heard_at: float = nan

    @property
    def bits(self) -> int:
        """Bits of the packets in the burst."""
        return self.packets * self.parcel.packet_bits

    def lose(self) -> None:
        """Mark every packet as lost."""
        self.mask, self.packets = np.zeros(self.mask.size, dtype=np.bool_), 0


def full_burst(source: int, to: int, parcel: Parcel, target: int) -> Burst:
    """Return a burst with all packets of a parcel."""
    return Burst(source, to, parcel, target, all_arrived(parcel.packets), parcel.packets)


class MacFrame:
    """One MAC frame: header, payload and check sequence.

    Attributes:
        to: The destination, or EVERYONE.
        bits: Length on the air.
        packets: Packets inside; 0 for an acknowledgement.
        target: The target that it is about; -1 for none.
        code: What the event log calls it: a code of the column `what`.
        kind: The event that logs its transmission: SEND or the code of `relay`.
        sequence: The number of its burst.
        sends: How often it was sent.
        retries: How often it was sent again after a failed attempt.
        acknowledged: Whether the sender of a unicast received an acknowledgement; None: the MAC does not say.
        owner: What the MAC keeps beside the frame while it is on the air.
    """

    __slots__ = (
        "acknowledged", "bits", "code", "kind", "owner", "packets", "retries", "sends", "sequence", "target", "to",
    )  # fmt: skip
    is_copy: ClassVar[bool] = False
    """Whether it is one of several copies that a MAC sends in a row, and counts as one frame."""

    def __init__(
        self, to: int, bits: int, packets: int = 1, target: int = -1, code: int = 0, kind: int = SEND, sequence: int = 0
    ) -> None:
        self.to = to
        self.bits = bits
        self.packets = packets
        self.target = target
        self.code = code
        self.kind = kind
        self.sequence = sequence
        self.sends = 0
        self.retries = 0
        self.acknowledged: bool | None = None
        self.owner: Any = None

    def finish(self, received: Received | None) -> None:
        """Take the final result of the frame; None if it never got the channel. A frame on its own ignores it."""

    def note_arrival(self, now: float) -> None:
        """Take that the destination of a unicast has received the frame; its sender may not know, and send it again."""


class OfferedFrame(MacFrame):
    """A broadcast of one payload without a burst.

    Args:
        bits: Length on the air.
        code: What the event log calls it.
        done: Called once with its result: the ids (n,) that received it, or None if it never got the channel.
    """

    __slots__ = ("_done",)

    def __init__(self, bits: int, code: int, done: Callable[[Received | None], None]) -> None:
        super().__init__(EVERYONE, bits, code=code)
        self._done = done

    def finish(self, received: Received | None) -> None:
        """Report the final result; None if the frame never got the channel."""
        self._done(received)
