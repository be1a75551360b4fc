"""X-MAC once more, plainly: senders around one receiver, written from the paper and from the documentation of `XMac`.

It shares no code with the package: see `plain_air`.
"""

from __future__ import annotations

import random
from math import floor
from typing import Any

from tests.network.plain_air import Air, Radio

TURN, ACK, WAIT, CCA = 192e-6, 88 / 250e3, 864e-6, 128e-6
STROBE, DATA, LONGEST, SPACING, LINGER, FIRST = 17 * 8 / 250e3, 29 * 8 / 250e3, 133 * 8 / 250e3, 640e-6, 10e-3, 10e-3
GAP = WAIT + TURN
PERIOD, WINDOW, ASSESSMENT = STROBE + GAP, 2 * STROBE + GAP, GAP + CCA
RETRIES, TRIES = 3, 8


class Node(Radio):
    """A node with X-MAC. `delivered` is the number of frames whose sender knows that they arrived."""

    def __init__(self, air: Air, interval: float, draw: random.Random, phase: float, first: float) -> None:
        super().__init__(air)
        self.first = first
        self.interval, self.draw = interval, draw
        self.needs: set[str] = set()
        self.until = 0.0
        self.queue: list[Any] = []
        self.working, self.state, self.turn = False, "idle", 0
        self.delivered = self.failed = 0
        self.heard_for_mine = -1.0
        air.at(phase, self.wake)

    # The radio: on in a window, or for a reason.
    def need(self, reason: str) -> None:
        self.needs.add(reason)
        self.turn_on()

    def drop(self, reason: str) -> None:
        self.needs.discard(reason)
        if not self.needs:
            self.turn_off()

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
    def later(self, seconds: float, action: Any) -> None:
        self.turn += 1
        turn = self.turn
        self.air.at(self.air.now + seconds, lambda: action() if turn == self.turn else None)

    def offer(self, to: Any) -> None:
        self.queue.append(to)
        if not self.working:
            self.begin()

    def begin(self) -> None:
        self.working, self.tries, self.retries = True, 0, 0
        self.pause()

    def pause(self) -> None:
        self.state = "pause"
        self.later(self.draw.random() * self.first, self.listen)

    def listen(self) -> None:
        self.state = "listen"
        self.need("send")
        self.later(ASSESSMENT, self.assess)

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

    def busy(self) -> None:
        self.drop("send")
        self.tries += 1
        self.state = "pause"
        if self.tries < TRIES:
            self.later(self.draw.random() * self.interval, self.pause)
        else:
            self.finish(False)

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

    def retry(self) -> None:
        self.drop("send")
        self.state = "pause"
        if self.retries == RETRIES:
            self.finish(False)
            return
        self.retries += 1
        self.tries = 0
        self.later(self.draw.random() * self.interval, self.pause)

    def finish(self, arrived: bool) -> None:
        to = self.queue.pop(0)
        self.delivered += arrived
        self.failed += not arrived
        self.turn += 1
        if arrived and self.queue and self.queue[0] is to:
            self.state, self.tries, self.retries = "data", 0, 0
            self.send_data()
            return
        self.drop("send")
        self.working, self.state = False, "idle"
        if self.queue:
            self.begin()

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
    """Let senders offer frames to node 0; return all nodes at the end.

    Args:
        frames: For each sender the times at which it offers a frame, in s.
        interval: The wake interval.
        seconds: The end.
        seed: Of the random numbers.
        phases: When each node first wakes; None: at random times.
        first: The longest random wait before a sender first listens.
    """
    air, draw = Air(), random.Random(seed)
    phases = phases or [draw.random() * interval for _ in range(len(frames) + 1)]
    nodes = [Node(air, interval, draw, phase, first) for phase in phases]
    for node, times in zip(nodes[1:], frames, strict=True):
        for time in times:
            air.at(time, lambda node=node: node.offer(nodes[0]))
    air.run(seconds)
    for node in nodes:
        node.turn_off()
    return nodes
