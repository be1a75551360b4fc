"""A plain simulation of radios within range of each other, without SimPy: a list of events, frames, who hears them.

It shares no code with the package. Every node hears every other one; two frames that overlap are lost to all.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Any


class Air:
    """The clock, the frames on the air, and the radios.

    `frames` holds all frames of the last tenth of a second as [start, end, sender, kind, to, spoilt].
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.frames: list[list[Any]] = []
        self.radios: list[Any] = []
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0

    def at(self, time: float, action: Callable[[], None]) -> None:
        """Do something at a time."""
        self._number += 1
        heapq.heappush(self._events, (time, self._number, action))

    def run(self, until: float) -> None:
        """Do what is due until a time."""
        while self._events and self._events[0][0] <= until:
            self.now, _, action = heapq.heappop(self._events)
            action()
        self.now = until

    def send(self, sender: Any, start: float, airtime: float, kind: str, to: Any, ended: Callable[[], None]) -> None:
        """Put a frame on the air; at its end all nodes that heard it are told, and then its sender."""
        frame = [start, start + airtime, sender, kind, to, False]
        self.frames = [other for other in self.frames if other[1] > start - 0.1]
        for other in self.frames:
            if other[1] > start and other[0] < frame[1]:
                other[5] = frame[5] = True
        self.frames.append(frame)
        sender.sent += airtime
        sender.count += 1

        def end() -> None:
            for radio in self.radios:
                if radio is not sender and radio.on_since is not None and radio.on_since <= start + 1e-12:
                    radio.hear(frame)
            ended()

        self.at(frame[1], end)

    def was_busy(self, node: Any, since: float) -> bool:
        """Whether a frame was on the air since a time, as far as a node can tell now."""
        return any(frame[1] > since and (frame[0] < self.now or frame[2] is node) for frame in self.frames)


class Radio:
    """A radio that is on or off.

    `on` adds up the seconds in which it was on, `sent` those in which it sent `count` frames.
    """

    def __init__(self, air: Air) -> None:
        self.air = air
        self.on_since: float | None = None
        self.on = 0.0
        self.sent = 0.0
        self.count = 0
        air.radios.append(self)

    def turn_on(self) -> None:
        if self.on_since is None:
            self.on_since = self.air.now

    def turn_off(self) -> None:
        if self.on_since is not None:
            self.on += self.air.now - self.on_since
            self.on_since = None

    def hear(self, frame: list[Any]) -> None:
        """A frame has ended during which the radio was on."""
