"""X-MAC once more, plainly: senders around one receiver, written from the paper and from the documentation of `XMac`.

It shares no code with the package: see `plain_air` and `plain_senders`.
"""

from __future__ import annotations

import random
from math import floor
from typing import Any

from tests.network.plain_air import Air
from tests.network.plain_senders import ACK, DATA, FIRST, LONGEST, SPACING, TURN, Sender, contend

WAIT, CCA, STROBE, LINGER = 864e-6, 128e-6, 17 * 8 / 250e3, 10e-3
GAP = WAIT + TURN
PERIOD, WINDOW, ASSESSMENT = STROBE + GAP, 2 * STROBE + GAP, GAP + CCA


class Node(Sender):
    """A node with X-MAC."""

    ASSESSMENT = ASSESSMENT
    OFF = 1.104e-3

    def __init__(self, air: Air, interval: float, draw: random.Random, phase: float, first: float) -> None:
        super().__init__(air, interval, draw, phase, first)
        self.heard_for_mine = -1.0

    # The radio: on in a window, or for a reason.
    def wake(self) -> None:
        self.air.at(self.air.now + self.interval, self.wake)
        if not self.needs:
            self.need("window")
            self.air.at(self.air.now + WINDOW, lambda: self.drop("window"))

    def stay(self, seconds: float) -> None:
        self.need("exchange")
        self.until = end = self.air.now + seconds
        self.air.at(end, lambda: self.drop("exchange") if self.until == end else None)

    def hear(self, frame: list[Any]) -> None:
        """What a node does with what it hears."""
        _, _, sender, kind, to, spoilt = frame
        if spoilt:
            return
        if to is self:
            self.answer(sender, kind)
        elif self.queue and self.state in ("listen", "wait", "direct"):
            self.overhear(sender, kind, to)
        self.needs.discard("window")
        if not self.needs:
            self.turn_off()

    # The receiver.
    def answer(self, sender: Any, kind: str) -> None:
        if kind == "strobe" and self.state not in ("train", "data"):
            self.stay(3 * TURN + ACK + LONGEST)
            self.air.send(self, self.air.now + TURN, ACK, "early", sender, lambda: None)
        elif kind == "data":
            self.stay(LINGER)
            self.air.send(self, self.air.now + TURN, ACK, "ack", sender, lambda: None)
        elif kind == "early" and self.state == "train":
            self.state = "data"
            self.turn += 1
            self.send_data()
        elif kind == "ack" and self.state == "data":
            self.later(SPACING, lambda: self.finish(True))

    # The sender.
    def assess(self) -> None:
        if not self.air.was_busy(self, self.air.now - ASSESSMENT):
            if self.state == "direct":
                self.state = "data"
                self.send_data()
            else:
                self.state, self.left = "train", floor(self.interval / PERIOD) + 2
                self.strobe()
        else:
            self.state = "wait"
            self.later(WINDOW, self.judge)

    def judge(self) -> None:
        if self.heard_for_mine >= self.air.now - WINDOW - ASSESSMENT:
            self.later(self.interval + TURN + LONGEST + TURN + ACK + TURN, self.busy)
        else:
            self.busy()

    def strobe(self) -> None:
        if self.left == 0:
            self.retry()
            return
        self.left -= 1
        self.air.send(self, self.air.now + TURN, STROBE, "strobe", self.queue[0], self.strobed)

    def strobed(self) -> None:
        """The gap: an early acknowledgement that has begun is waited for."""
        self.later(WAIT, self.strobe)

    def send_data(self) -> None:
        self.air.send(self, self.air.now + TURN, DATA, "data", self.queue[0], lambda: self.later(WAIT, self.retry))

    def follow(self) -> None:
        self.state = "data"
        self.send_data()

    def overhear(self, sender: Any, kind: str, to: Any) -> None:
        mine = self.queue[0]
        if to is mine and kind in ("strobe", "data"):
            self.heard_for_mine = self.air.now
        elif sender is mine and kind == "early" and self.state in ("wait", "direct"):
            self.later(TURN + LONGEST + TURN + ACK + TURN, self.busy)
        elif sender is mine and kind == "ack" and self.state in ("wait", "direct"):
            self.state = "direct"
            spread = max(LINGER - (TURN + ACK) - TURN - LONGEST, 0.0)
            self.later(max(spread * self.draw.random(), ASSESSMENT), self.assess)


def contention(
    frames: list[list[float]],
    interval: float,
    seconds: float,
    seed: int,
    phases: list[float] | None = None,
    first: float = FIRST,
) -> list[Node]:
    """Let senders with X-MAC offer frames to node 0: see `contend`. `first`: the longest wait before they listen."""
    return contend(
        lambda air, draw, phase: Node(air, interval, draw, phase, first), frames, interval, seconds, seed, phases
    )
