"""The forwarding engine of one node of a collection tree: a queue of datagrams, sent one after another to the parent.

A datagram that is not acknowledged is sent again, at most `retries` times, to whoever is the parent then. After each
transmission the node pauses. Every frame carries the cost of its sender's route, which must fall from hop to hop: a
node whose route does not cost less than the sender's suspects a loop. It then beacons soon, and pauses for longer
before it goes on. A copy that a node has had before is dropped.

Source: Gnawali, Fonseca, Jamieson, Moss, Levis (2009), "Collection tree protocol", SenSys; the pauses, in multiples of
the time of a packet, and the number of remembered datagrams are those of TinyOS 2.1 (lib/net/ctp). Ours:
retransmissions of the MAC count, and a datagram waits for a route for a limited time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple, Protocol

import simpy

from wsnsim.base.frames import Burst
from wsnsim.network.radio.datagrams import Copy, Hops
from wsnsim.network.radio.tree_node import TreeNode

REMEMBERED: Final = 4
"""Datagrams that a node remembers after it has sent them on."""
MOST_HOPS: Final = 255
"""Hops after which a datagram is dropped: their number, THL, is one byte."""
SHORT: Final = 1.0
"""A pause lasts for one to two times this many packet times after a frame."""
LONG: Final = 4.0
"""The same after a frame that never got the channel, and where a loop is suspected."""


class QueueRules(NamedTuple):
    """Retransmissions, length of the queue, time of a packet in s, and time in s that a datagram waits for a route."""

    retries: int
    size: int
    packet_time: float
    patience: float


class TreeNetwork(Protocol):
    """What the queue of a node tells the tree."""

    def receive(self, node: int, copy: Copy, cost: float, burst: Burst) -> None:
        """A node has received a copy; the route of the sender cost `cost` when it was sent."""

    def note_sent(self, node: int, to: int, burst: Burst) -> None:
        """A node has sent a burst to another, and knows whether it was acknowledged."""


class TreeQueue:
    """The datagrams that one node sends on."""

    __slots__ = (
        "_copies", "_env", "_free_at", "_hops", "_in_flight", "_network", "_recent", "_route", "_rules", "_stopped",
        "_timer", "_uniform",
    )  # fmt: skip

    def __init__(
        self, env: simpy.Environment, route: TreeNode, rules: QueueRules, network: TreeNetwork, hops: Hops,
        uniform: Callable[[], float],
    ) -> None:  # fmt: skip
        self._env = env
        self._route = route
        self._rules = rules
        self._network = network
        self._hops = hops
        self._uniform = uniform
        self._copies: deque[Copy] = deque()
        self._recent: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self._in_flight: Copy | None = None
        self._free_at = 0.0
        self._timer = 0
        self._stopped = False

    def knows(self, copy: Copy) -> bool:
        """Whether the node has had this copy: it is in the queue, or was sent on lately."""
        return copy.key in self._recent or any(copy.key == other.key for other in self._copies)

    def remember(self, copy: Copy) -> None:
        """Note a copy that the node has sent on, or that has arrived at it."""
        self._recent.append(copy.key)

    def add(self, copy: Copy) -> None:
        """Put a copy in the queue, or drop it."""
        copy.journey.add_copy()
        if len(self._copies) >= self._rules.size:
            self._drop(copy, "queue_full")
        elif copy.hops >= MOST_HOPS:
            self._drop(copy, "hop_limit")
        else:
            self._copies.append(copy)
            self.resume()

    def suspect_loop(self) -> None:
        """Pause for long: the route that the sender of a datagram believes in may lead back to it."""
        self._pause(LONG)

    def resume(self) -> None:
        """Send the first datagram, now or after the pause; without a route, wait for one."""
        while self._copies and not self._stopped and self._in_flight is None:
            now, first = self._env.now, self._copies[0]
            given_up = first.since + self._rules.patience
            if now < self._free_at:
                self._wait(self._free_at - now)
            elif self._route.has_route:
                self._send(first)
            elif now < given_up:
                self._wait(given_up - now)
            else:
                self._drop(self._copies.popleft(), "no_route")
                continue
            return

    def stop(self) -> None:
        """The node is down: its datagrams are lost. What it is sending may have arrived."""
        self._stopped = True
        for copy in self._copies:
            if copy is not self._in_flight:
                copy.journey.end_copy()

    def _wait(self, seconds: float) -> None:
        """Resume after some time. Of several such times the last one that was set counts."""
        self._timer += 1
        wake = partial(self._wake, self._timer)
        event = self._env.timeout(seconds)
        assert event.callbacks is not None, "a timeout has not passed yet"
        event.callbacks.append(lambda _: wake())

    def _wake(self, timer: int) -> None:
        if timer == self._timer:
            self.resume()

    def _send(self, copy: Copy) -> None:
        to, cost = self._route.parent, self._route.cost
        burst = copy.burst(self._route.node, to)
        self._in_flight = copy
        event = self._hops.send([burst])
        assert event.callbacks is not None, "a burst ends later than it is sent"
        event.callbacks.append(lambda _: self._sent(copy, burst, cost))

    def _sent(self, copy: Copy, burst: Burst, cost: float) -> None:
        """Take the result of a burst: go on with the next datagram, or try again."""
        self._in_flight = None
        copy.journey.datagram.bits += burst.sent
        copy.sequence = burst.sequence
        if burst.packets:
            self._network.receive(burst.to, copy.after(burst, self._env.now), cost, burst)
        if self._stopped:
            copy.journey.end_copy()
            return
        self._network.note_sent(self._route.node, burst.to, burst)
        copy.tries += max(burst.attempts, 1)
        if burst.acknowledged:
            self._copies.popleft()
            self.remember(copy)
            copy.journey.end_copy()
        elif copy.tries > self._rules.retries:
            self._drop(self._copies.popleft(), "retry_limit")
        self._pause(SHORT if burst.attempts else LONG)
        self.resume()

    def _pause(self, packet_times: float) -> None:
        """Do not send for one to two times this number of packet times."""
        seconds = packet_times * self._rules.packet_time * (1.0 + self._uniform())
        self._free_at = max(self._free_at, self._env.now + seconds)

    def _drop(self, copy: Copy, reason: str) -> None:
        journey = copy.journey
        if journey.is_last_copy:
            self._hops.drop(journey.datagram, self._route.node, journey.target, reason, copy.sequence)
        journey.end_copy()
