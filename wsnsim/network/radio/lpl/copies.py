"""Copies of a frame: a sender of ContikiMAC repeats it until it is acknowledged, or for a whole wake interval.

The counters of the run and those of links count all copies of a try together, as one frame.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, MacFrame
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import Transmission


class FrameCopy(MacFrame):
    """One of the copies of a frame that are sent in a row."""

    __slots__ = ("original",)
    is_copy = True

    def __init__(self, original: MacFrame) -> None:
        super().__init__(
            original.to, original.bits, original.packets, original.target, original.code, original.kind,
            original.sequence,
        )  # fmt: skip
        self.original = original

    def note_arrival(self, now: float) -> None:
        """Note that the frame has arrived."""
        self.original.note_arrival(now)


class CopyTrain:
    """The copies of a frame in one try.

    Attributes:
        left: Copies that may still be sent.
        until: When the last one may begin, in s.
        wakes: Whether the destination sleeps when they begin, so that an acknowledgement says when it wakes.
        start: When the last one began, in s.
        reached: Nodes that received one.
        last: The last transmission; None before the first.
    """

    __slots__ = ("last", "left", "reached", "start", "until", "wakes")

    def __init__(self, left: int, until: float, wakes: bool) -> None:
        self.left = left
        self.until = until
        self.wakes = wakes
        self.start = 0.0
        self.reached: set[int] = set()
        self.last: Transmission | None = None

    def received(self) -> Ints:
        """(n,) the nodes that received a copy, ascending."""
        return np.array(sorted(self.reached), dtype=np.int64)


class CopyCounts:
    """Counts the tries of frames: each as one frame, whatever the number of its copies."""

    def __init__(self, services: NetworkMacServices) -> None:
        self._counters = services.counters
        self._links = services.links
        self._nodes = services.radio.nodes
        self._topology = services.radio.topology

    def count(self, frame: MacFrame, train: CopyTrain) -> None:
        """Count a try that has ended."""
        sent = train.last
        if sent is None or not frame.packets:
            return
        counters, received = self._counters, train.received()
        if frame.to == EVERYONE:
            self._links.count(sent, received)
            meant = self._meant(sent)
        else:
            meant = np.array([frame.to] if self._nodes.alive[frame.to] else [], dtype=np.int64)
        delivered = int(np.isin(meant, received).sum())
        counters.frames_sent += 1
        counters.packets_sent += frame.packets
        counters.in_range += meant.size
        counters.delivered += delivered
        counters.frames_lost += delivered < max(meant.size, frame.to != EVERYONE)

    def _meant(self, sent: Transmission) -> Ints:
        """(n,) the neighbours that a broadcast is meant for: those that are awake, over reliable links."""
        neighbours = sent.neighbours
        reliable = self._topology.reliable(neighbours, sent.frame.bits)
        return neighbours.ids[reliable & self._nodes.hears(neighbours.ids, sent.start)]
