"""A frame: what a MAC wants on the air, and the same while it is there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.tables import KIND
from wsnsim.network.radio.ideal_medium import EVERYONE
from wsnsim.network.radio.topology import Neighbours

SEND = KIND["send"]
FREE: Final = (0.0, 0.0, 0.0, 0.0)


class MacFrame:
    """One frame that a MAC wants on the air: `bits` there, `packets` inside, what the log calls it.

    `sends`: how often it was on the air; `retries`: of these, after the first.
    """

    __slots__ = ("bits", "code", "kind", "packets", "retries", "sends", "sequence", "target", "to")

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


class Transmission:
    """A frame on the air from `start` to `end`. `others`: those that overlap it. `cut`: its sender fell silent.

    `missed`: somebody whom it should have reached did not get it.
    """

    __slots__ = (
        "asleep",
        "audience",
        "costs",
        "cut",
        "end",
        "landed",
        "message",
        "missed",
        "number",
        "others",
        "owner",
        "source",
        "start",
    )

    def __init__(
        self, source: int, message: MacFrame, audience: Neighbours, number: int, start: float, end: float,
        owner: Any, landed: Landed,
    ) -> None:  # fmt: skip
        self.source = source
        self.message = message
        self.audience = audience
        self.number = number
        self.start = start
        self.end = end
        self.owner = owner
        self.landed = landed
        self.others: list[Transmission] | None = None
        self.cut = False
        self.missed = False
        self.asleep: Ints | None = None
        self.costs = FREE


Heard = Any
"""Of a broadcast, the ids (n,) that received it; of a unicast, whether its destination did."""
Landed = Callable[[Transmission, Heard], None]


def meet(one: Transmission, other: Transmission) -> None:
    """Two frames overlap in time."""
    if one.others is None:
        one.others = []
    if other.others is None:
        other.others = []
    one.others.append(other)
    other.others.append(one)


def nobody(message: MacFrame) -> Heard:
    """What is said of a frame that nobody heard."""
    return np.zeros(0, dtype=np.int64) if message.to == EVERYONE else False
