"""What senders of `plain_xmac` and `plain_contikimac` have in common: a queue, tries, and reasons to be on.

It shares no code with the package: see `plain_air`.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

from tests.network.plain_air import Air, Radio

TURN, ACK, DATA, LONGEST = 192e-6, 88 / 250e3, 29 * 8 / 250e3, 133 * 8 / 250e3
SPACING, FIRST = 640e-6, 10e-3
RETRIES, TRIES = 3, 8


class Sender(Radio):
    """A node with a queue. `delivered` is the number of frames whose sender knows that they arrived.

    The class of a MAC says how long a sender first listens (`ASSESSMENT`), how long its radio takes to stop and start
    (`OFF`), and what it does when its radio wakes (`wake`), after it has listened (`assess`), and with a further frame
    for the same destination (`follow`).
    """

    ASSESSMENT: ClassVar[float]
    OFF: ClassVar[float]

    def __init__(self, air: Air, interval: float, draw: random.Random, phase: float, first: float) -> None:
        super().__init__(air)
        self.first = first
        self.interval, self.draw = interval, draw
        self.needs: set[str] = set()
        self.until = 0.0
        self.queue: list[Any] = []
        self.working, self.state, self.turn = False, "idle", 0
        self.delivered = self.failed = 0
        air.at(phase, self.wake)

    def wake(self) -> None:
        raise NotImplementedError

    def assess(self) -> None:
        raise NotImplementedError

    def follow(self) -> None:
        raise NotImplementedError

    # The radio is on while there is a reason.
    def need(self, reason: str) -> None:
        self.needs.add(reason)
        self.turn_on()

    def drop(self, reason: str) -> None:
        self.needs.discard(reason)
        if not self.needs:
            self.turn_off()

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
        self.rest(self.draw.random() * self.first)

    def rest(self, seconds: float) -> None:
        """Listen after some time; a radio that is off, or on for a channel check only, stops and starts before."""
        held = self.needs - {"window", "check"}
        self.later(max(seconds, 0.0 if held else self.OFF), self.listen)

    def listen(self) -> None:
        self.state = "listen"
        self.need("send")
        self.later(self.ASSESSMENT, self.assess)

    def busy(self) -> None:
        self.drop("send")
        self.tries += 1
        self.state = "pause"
        if self.tries < TRIES:
            self.later(self.draw.random() * self.interval, self.pause)
        else:
            self.finish(False)

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
            self.tries, self.retries = 0, 0
            self.follow()
            return
        self.drop("send")
        self.working, self.state = False, "idle"
        if self.queue:
            self.begin()


Node = TypeVar("Node", bound=Sender)


def contend(
    make: Callable[[Air, random.Random, float], Node],
    frames: list[list[float]],
    interval: float,
    seconds: float,
    seed: int,
    phases: list[float] | None,
) -> list[Node]:
    """Let senders offer frames to node 0; return all nodes at the end.

    Args:
        make: Makes a node of the air, random numbers, and the time when it first wakes.
        frames: For each sender the times at which it offers a frame, in s.
        interval: The wake interval.
        seconds: The end.
        seed: Of the random numbers.
        phases: When each node first wakes; None: at random times.
    """
    air, draw = Air(), random.Random(seed)
    phases = phases or [draw.random() * interval for _ in range(len(frames) + 1)]
    nodes = [make(air, draw, phase) for phase in phases]
    for node, times in zip(nodes[1:], frames, strict=True):
        for time in times:
            air.at(time, lambda node=node: node.offer(nodes[0]))
    air.run(seconds)
    for node in nodes:
        node.turn_off()
    return nodes
