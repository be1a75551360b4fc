"""The messages of an event log: the bursts of each, hop by hop, and their outcomes.

LoggedMessage, LoggedBurst      a unicast over its hops, a broadcast, or a flood: a broadcast that other nodes forward
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

EVERYONE: Final = -1


@dataclass(slots=True)
class LoggedBurst:
    """One burst on the air.

    Attributes:
        number: number of the burst; column `frame` of the events.
        source: the sender.
        to: the addressed node, or `EVERYONE`.
        packets: packets sent.
        bits: bits sent.
        received: {node: packets that it received}.
        collided: nodes at which it collided.
        dropped: nodes at which it was lost otherwise.
    """

    number: int
    source: int
    to: int
    packets: int
    bits: int
    received: dict[int, int] = field(default_factory=dict)
    collided: list[int] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)

    @property
    def arrived(self) -> bool:
        """Whether the addressed node received it; of a broadcast, whether it was lost nowhere."""
        return self.to in self.received if self.to != EVERYONE else not (self.collided or self.dropped)


@dataclass(slots=True)
class LoggedMessage:
    """A message with its bursts, hop by hop.

    Attributes:
        time: time of its first event, in s.
        until: time of its last event, in s.
        what: what the parcel carried.
        target: number of the target.
        source: the first sender.
        to: the addressed node of the first burst, or `EVERYONE`.
        begun: whether its first burst is in this step.
        goes_on: whether a later step has events of it.
        relayed: whether its first event in this step is a relay event.
        ended: reason why a burst of it was not sent ('no_path', 'no_channel', ...); '' if all were sent.
        most: packets of its largest burst.
        joules: energy of its senders and addressed receivers, wake-up calls included, overhearing excluded.
        frames: its bursts, without acknowledgements.
        acknowledgements: number of acknowledgements received.
        callers: nodes that sent wake-up calls for it.
        woken: nodes that these calls woke.
        expired: nodes at which it expired.
    """

    time: float
    until: float
    what: str
    target: int
    source: int
    to: int
    begun: bool = True
    goes_on: bool = False
    relayed: bool = False
    ended: str = ""
    most: int = 0
    joules: float = 0.0
    frames: list[LoggedBurst] = field(default_factory=list)
    acknowledgements: int = 0
    callers: list[int] = field(default_factory=list)
    woken: list[int] = field(default_factory=list)
    expired: list[int] = field(default_factory=list)

    @property
    def path(self) -> tuple[int, ...]:
        """The nodes of its path, from the first sender to the last addressed node."""
        nodes = [self.source]
        for burst in self.frames:
            if burst.source == nodes[-1] and burst.to != EVERYONE:
                nodes.append(burst.to)
        return tuple(nodes)

    @property
    def hop(self) -> list[LoggedBurst]:
        """The bursts of its last hop."""
        last = self.frames[-1]
        return [burst for burst in self.frames if (burst.source, burst.to) == (last.source, last.to)]

    @property
    def packets(self) -> int:
        """Packets that arrived over its last hop, summed over bursts; the packets sent, if none arrived."""
        if self.is_broadcast or not self.frames:
            return self.most
        got = sum(burst.received.get(burst.to, 0) for burst in self.hop)
        return max(got, self.most)

    @property
    def bits(self) -> int:
        """Bits put on the air, summed over bursts and hops."""
        return sum(burst.bits for burst in self.frames)

    @property
    def is_broadcast(self) -> bool:
        """Whether it was for all nodes in range."""
        return self.to == EVERYONE

    @property
    def heard(self) -> set[int]:
        """The nodes that received a burst of it."""
        return {node for burst in self.frames for node in burst.received}

    @property
    def forwarders(self) -> list[int]:
        """The nodes that forwarded a broadcast, in order of time."""
        return [burst.source for burst in self.frames if burst.source != self.source] if self.is_broadcast else []

    @property
    def is_flood(self) -> bool:
        """Whether it is a broadcast that was forwarded or that woke nodes."""
        return self.is_broadcast and bool(self.forwarders or self.callers or self.expired)
