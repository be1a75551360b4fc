"""ContikiMAC once more, plainly: senders around one receiver, written from the report and from `ContikiMac`'s text.

It shares no code with the package: see `plain_air` and `plain_senders`. Every channel check is an event here.
"""

from __future__ import annotations

import random
from math import ceil, floor
from typing import Any

from tests.network.plain_air import Air
from tests.network.plain_senders import ACK, DATA, FIRST, LONGEST, SPACING, TURN, Sender, contend

T_R, T_C, T_I, LINGER, GUARD = 192e-6, 500e-6, 400e-6, 31.25e-3, 2e-3
PERIOD, ASSESSMENT = DATA + T_I, T_C + 2 * T_R
AWAKE = 3


class Node(Sender):
    """A node with ContikiMAC."""

    ASSESSMENT = ASSESSMENT
    OFF = 0.244e-3

    def __init__(self, air: Air, interval: float, draw: random.Random, locks: bool, phase: float, first: float) -> None:
        super().__init__(air, interval, draw, phase, first)
        self.locks = locks
        self.known: float | None = None
        self.ends = float("inf")
        self.follows = False

    # The wake-up: two assessments; who hears something stays on.
    def wake(self) -> None:
        self.air.at(self.air.now + self.interval, self.wake)
        if not self.needs:
            self.need("check")
            self.air.at(self.air.now + T_R, lambda: self.checked(True))

    def checked(self, first: bool) -> None:
        if "check" not in self.needs:
            return
        until = max((frame[1] for frame in self.air.frames if frame[0] <= self.air.now < frame[1]), default=0.0)
        if until:
            self.needs.add("frame")
            self.needs.discard("check")
            self.since = self.air.now
            self.air.at(until, self.partly_heard)
            return
        self.drop("check")
        if first and not self.needs:
            self.air.at(self.air.now + T_C, self.second)

    def second(self) -> None:
        if not self.needs:
            self.need("check")
            self.air.at(self.air.now + T_R, lambda: self.checked(False))

    def partly_heard(self) -> None:
        """What woke the node has ended. Fast sleep: too long an activity, or too long a silence."""
        still = any(frame[0] <= self.air.now < frame[1] - 1e-12 for frame in self.air.frames)
        if still and self.air.now - self.since > LONGEST:
            self.drop("frame")
        elif still:
            pass  # the end of the other frame decides
        else:
            self.air.at(self.air.now + T_I + T_R, self.silent)

    def silent(self) -> None:
        on_air = any(frame[0] <= self.air.now < frame[1] for frame in self.air.frames)
        if "frame" in self.needs and not on_air:
            self.drop("frame")

    def hear(self, frame: list[Any]) -> None:
        """A frame was heard from its start on: it is the node's own, or somebody else's, or cannot be read."""
        _, _, sender, kind, to, spoilt = frame
        if not spoilt and to is self:
            self.answer(sender, kind)
        self.drop("frame")

    def answer(self, sender: Any, kind: str) -> None:
        if kind == "data":
            more = len(sender.queue) > 1
            self.need("exchange")
            self.until = end = self.air.now + TURN + ACK + (LINGER if more else TURN)
            self.air.at(end, lambda: self.drop("exchange") if self.until == end else None)
            sender.answered = True
            self.air.send(self, self.air.now + TURN, ACK, "ack", sender, lambda: None)
        elif self.state == "train":
            if not self.follows:  # a receiver that waits for the next frame does not say when it wakes
                self.known = self.start
            self.later(SPACING, lambda: self.finish(True))

    # The sender.
    def pause(self) -> None:
        """Wait for a random time, or until shortly before the receiver wakes."""
        self.state, self.ends, wait = "pause", float("inf"), self.draw.random()
        if self.known is None:
            self.rest(wait * self.first)
            return
        early = GUARD * (1.0 + wait) + ASSESSMENT + TURN + PERIOD
        turns = ceil((self.air.now + early - self.known) / self.interval)
        expected = self.known + turns * self.interval
        self.ends = expected + PERIOD + GUARD
        self.rest(expected - early - self.air.now)

    def assess(self) -> None:
        if self.air.was_busy(self, self.air.now - ASSESSMENT):
            self.busy()
        else:
            self.follows = False
            self.state, self.left = "train", floor(self.interval / PERIOD) + 2
            self.copy()

    def copy(self) -> None:
        if self.left == 0 or self.air.now + TURN > self.ends:
            if not self.follows:
                self.known = None
            self.retry()
            return
        self.left -= 1
        self.start, self.answered = self.air.now + TURN, False
        self.air.send(self, self.start, DATA, "data", self.queue[0], self.copied)

    def copied(self) -> None:
        """Without an acknowledgement that begins, the next copy follows; one that cannot be read ends the train."""
        if self.answered:
            self.later(TURN + ACK + 1e-9, self.retry)
        else:
            self.later(T_I - TURN, self.copy)

    def finish(self, arrived: bool) -> None:
        if not self.locks:
            self.known = None
        super().finish(arrived)

    def follow(self) -> None:
        self.state, self.left, self.ends = "train", AWAKE, float("inf")
        self.follows = True
        self.copy()


def contention(
    frames: list[list[float]],
    interval: float,
    seconds: float,
    seed: int,
    locks: bool,
    phases: list[float] | None = None,
    first: float = FIRST,
) -> list[Node]:
    """Let senders with ContikiMAC offer frames to node 0: see `contend`.

    `locks`: whether they learn when the receiver wakes. `first`: the longest wait before they listen.
    """
    return contend(
        lambda air, draw, phase: Node(air, interval, draw, locks, phase, first), frames, interval, seconds, seed, phases
    )
