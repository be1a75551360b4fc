"""Contention periods: when a node may send frames outside slots.

    periods.closed_until(node) -> event or None      periods.close(head) -> s until the round may begin

A round of slots closes the contention period of the nodes in range of its head or of a member with a slot: they hear
frames that say how long the round will last, as the duration field of IEEE 802.11 does. They hold frames outside slots
back until the round has ended. An exchange that is under way, a frame and its acknowledgement, delays the round. That
all of these nodes know a round from its first instant on is an idealisation of ours. A node out of range of all of them
may still disturb a member that receives.
"""

from __future__ import annotations

from collections.abc import Iterable

import simpy


class ContentionPeriods:
    """Which nodes hold frames back, until when, and which exchanges are under way."""

    def __init__(self, env: simpy.Environment) -> None:
        self._env = env
        self._informed: dict[int, set[int]] = {}
        """{head: the nodes that hear its rounds, and the head itself}"""
        self._rounds: dict[int, simpy.Event] = {}
        """{head with a round under way: fires at its end}"""
        self._ended: dict[int, float] = {}
        """{head: the end of its last round in s}"""
        self._exchanges: dict[int, float] = {}
        """{node: the end of its last exchange outside slots in s}"""

    def inform(self, head: int, nodes: set[int]) -> None:
        """Set which nodes hear the rounds of a head."""
        self._informed[head] = nodes | {head}

    def closed_until(self, node: int) -> simpy.Event | None:
        """The end of a round that a node hears; None: it may contend."""
        for head, ended in self._rounds.items():
            if node in self._informed[head]:
                return ended
        return None

    def note_exchange(self, nodes: Iterable[int], seconds: float) -> None:
        """Note that nodes exchange a frame and its acknowledgement, from now on for `seconds`."""
        for node in nodes:
            self._exchanges[node] = self._env.now + seconds

    def left(self, head: int, shortest: float) -> float:
        """Seconds that remain of the contention period after a head's last round, if it lasts `shortest` s."""
        ended = self._ended.get(head)
        return 0.0 if ended is None else max(ended + shortest - self._env.now, 0.0)

    def close(self, head: int) -> float:
        """Close the period for the nodes that hear a head's rounds; seconds until their exchanges are over."""
        self._rounds[head] = self._env.event()
        exchanges, now = self._exchanges, self._env.now
        informed = self._informed.setdefault(head, {head})
        return max(
            (exchanges[node] - now for node in informed & exchanges.keys() if exchanges[node] > now), default=0.0
        )

    def reopen(self, head: int) -> None:
        """End a head's round; the frames that were held back contend."""
        self._ended[head] = self._env.now
        self._rounds.pop(head).succeed()
