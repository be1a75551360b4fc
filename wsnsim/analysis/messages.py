"""A parcel under way, as the events of a result show it: its frames hop by hop, and what became of each.

LoggedMessage, LoggedBurst      a unicast over its hops, a broadcast, or a flood: a broadcast that others hand on
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

EVERYONE: Final = -1


@dataclass(slots=True)
class LoggedBurst:
    """One burst on the air: who got how many packets of it, at whom it collided, and where it was lost otherwise."""

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
        """Whether the node it was for got it, or all of it where it was for everyone."""
        return self.to in self.received if self.to != EVERYONE else not (self.collided or self.dropped)


@dataclass(slots=True)
class LoggedMessage:
    """A parcel under way: its frames hop by hop, acknowledgements left out, and `joules` of all who sent or listened.

    `ended`: why a frame of it never got on the air ('no_path', 'no_channel', ...); '' if none. `begun`: whether its
    first frame is in the rows; `goes_on`: whether later steps know of it; `relayed`: the first of the rows passes it
    on. Overhearing is not in `joules`. Where it wakes nodes: `callers` on the wake-up radio, whom they have `woken`,
    and at whom it `expired`; the calls are in `joules`.
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
        """The nodes that it passed, from the first sender to the last addressee."""
        nodes = [self.source]
        for frame in self.frames:
            if frame.source == nodes[-1] and frame.to != EVERYONE:
                nodes.append(frame.to)
        return tuple(nodes)

    @property
    def hop(self) -> list[LoggedBurst]:
        """The frames of its last hop."""
        last = self.frames[-1]
        return [frame for frame in self.frames if (frame.source, frame.to) == (last.source, last.to)]

    @property
    def packets(self) -> int:
        """Packets that arrived over its last hop, each frame counted; those that should have, if none did."""
        if self.is_broadcast or not self.frames:
            return self.most
        got = sum(frame.received.get(frame.to, 0) for frame in self.hop)
        return max(got, self.most)

    @property
    def bits(self) -> int:
        """Bits put on the air, each frame and hop counted."""
        return sum(frame.bits for frame in self.frames)

    @property
    def is_broadcast(self) -> bool:
        """Whether it was for everyone within reach."""
        return self.to == EVERYONE

    @property
    def heard(self) -> set[int]:
        """Who got a frame of it, or of a copy of it."""
        return {node for frame in self.frames for node in frame.received}

    @property
    def forwarders(self) -> list[int]:
        """Who handed on a broadcast of another, in the order in which they did."""
        return [frame.source for frame in self.frames if frame.source != self.source] if self.is_broadcast else []

    @property
    def is_flood(self) -> bool:
        """Whether it is a broadcast that was handed on, or that woke nodes."""
        return self.is_broadcast and bool(self.forwarders or self.callers or self.expired)
