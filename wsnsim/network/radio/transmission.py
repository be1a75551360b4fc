"""A transmission: one MAC frame on the air, from its start to its end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.network.radio.topology import Neighbours

FREE: Final = (0.0, 0.0, 0.0, 0.0)


class Transmission:
    """One MAC frame on the air.

    Attributes:
        source: The sender.
        frame: What is sent.
        neighbours: The nodes that it may reach.
        number: Its number in the event log.
        start: When its first bit is sent, in s.
        end: When its last bit is sent, in s.
        on_end: Called at the end, with the transmission and the result.
        overlapping: The transmissions that overlap it; None for none.
        cut: Whether its sender fell silent before the end.
        missed: Whether a node that it was meant for did not receive it.
        asleep: Ids of nodes that have the radio off because they know that the frame is not for them.
        costs: (electronics J, amplifier J, reception J, airtime s).
        locks: (n,) which neighbours are locked on it (see `capture`); None until they are first needed.
        listeners: (m,) the nodes whose radios listened from its start and paid for it: they received or overheard it,
            or lost it to another frame. Ascending. None until its end, and where all radios listen.
    """

    __slots__ = (
        "asleep",
        "costs",
        "cut",
        "end",
        "frame",
        "listeners",
        "locks",
        "missed",
        "neighbours",
        "number",
        "on_end",
        "overlapping",
        "source",
        "start",
    )

    def __init__(
        self, source: int, frame: MacFrame, neighbours: Neighbours, number: int, start: float, end: float,
        on_end: OnEnd,
    ) -> None:  # fmt: skip
        self.source = source
        self.frame = frame
        self.neighbours = neighbours
        self.number = number
        self.start = start
        self.end = end
        self.on_end = on_end
        self.overlapping: list[Transmission] | None = None
        self.cut = False
        self.missed = False
        self.asleep: Ints | None = None
        self.costs = FREE
        self.locks: Bools | None = None
        self.listeners: Ints | None = None


OnEnd = Callable[[Transmission, Received], None]


def overlap(a: Transmission, b: Transmission) -> None:
    """Note that two transmissions overlap in time."""
    if a.overlapping is None:
        a.overlapping = []
    if b.overlapping is None:
        b.overlapping = []
    a.overlapping.append(b)
    b.overlapping.append(a)


def received_by_none(frame: MacFrame) -> Received:
    """The result of a frame that no node received."""
    return np.zeros(0, dtype=np.int64) if frame.to == EVERYONE else False
