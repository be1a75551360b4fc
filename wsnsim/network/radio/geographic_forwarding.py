"""Geographic forwarding by what nodes have heard: datagrams to a node whose position the sender knows.

Beacons say where their senders assume to stand. A node passes a datagram to the destination itself, if that is within
the nominal range; otherwise to the neighbour with the most progress per transmission, the metres by which it is nearer
to the destination divided by the ETX of the link. Progress is strict, so that no copy can go in a circle. If a hop is
not acknowledged, the next best neighbour is tried; without one, or after `most` bursts, the copy is dropped. A burst
that never got the channel says nothing of its link: the node pauses, as for datagrams to sinks, and sends it again.

Source: progress times packet reception ratio: Seada, Zuniga, Helmy, Krishnamachari (2004), "Energy-efficient forwarding
strategies for geographic routing in lossy wireless sensor networks", SenSys. Ours: the ETX in its place, and that the
destination in range is tried first, whether a beacon of it was heard or not.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final

from wsnsim.base.frames import Burst
from wsnsim.network.event_log import Acting
from wsnsim.network.radio.datagrams import Copy, Hops, Journey
from wsnsim.network.radio.link_estimator import LinkTable
from wsnsim.network.radio.topology import RadioServices

REMEMBERED: Final = 16
"""Datagrams that a node remembers after it has received them (our choice)."""
Place = tuple[float, float]


class HeardPlaces:
    """Where the neighbours of one node assume to stand, and the links to them, at most `size`."""

    __slots__ = ("links", "places", "recent", "uniform")

    def __init__(self, size: int, uniform: Callable[[], float]) -> None:
        self.links = LinkTable(size, uniform)
        self.uniform = uniform
        self.places: dict[int, Place] = {}
        self.recent: deque[tuple[int, bytes]] = deque(maxlen=REMEMBERED)

    def hear(self, sender: int, number: int, place: Place) -> None:
        """Note a beacon by its number."""
        known, evicted = self.links.hear(sender, number)
        if evicted is not None:
            self.places.pop(evicted, None)
        if known:
            self.places[sender] = place

    def best(self, here: Place, there: Place, tried: set[int]) -> int | None:
        """The neighbour with the most progress per transmission, of those not tried yet; None if none is nearer."""
        away = math.dist(here, there)
        worth = [
            ((away - math.dist(place, there)) / self.links.etx(node), -node)
            for node, place in self.places.items()
            if node not in tried
        ]
        progress, node = max(worth, default=(0.0, 0))
        return -node if progress > 0.0 else None


class GeographicForwarding:
    """Forwards datagrams from node to node by assumed positions.

    Args:
        radio: The services of the radio.
        hops: How bursts cross one hop.
        heard: What each node that is up has heard.
        most: The number of bursts that one node sends of one datagram.
        pause: Seconds that a node pauses at least after a burst that never got the channel, and as long again at most.
    """

    def __init__(
        self, radio: RadioServices, hops: Hops, heard: dict[int, HeardPlaces], most: int, pause: float
    ) -> None:  # fmt: skip
        self._env = radio.env
        self._nodes = radio.nodes
        self._hops = hops
        self._heard = heard
        self._most = most
        self._pause = pause

    def send(self, copy: Copy, node: int) -> None:
        """Send a copy on from a node that has it."""
        copy.journey.add_copy()
        self._env.process(self._pass_on(copy, node))

    def _pass_on(self, copy: Copy, node: int) -> Acting[None]:
        """Try one neighbour after another, until one acknowledges the copy."""
        journey, heard = copy.journey, self._heard.get(node)
        tried: set[int] = set()
        bursts = 0
        while heard is not None and self._heard.get(node) is heard:
            to = self._next(journey, node, heard, tried)
            if to is None or bursts >= self._most:
                reason = "retry_limit" if bursts else "void"
                if journey.is_last_copy:
                    self._hops.drop(journey.datagram, node, journey.target, reason, copy.sequence)
                break
            waking = self._hops.waking(node, to, journey.target) if to == journey.datagram.to else None
            if waking is not None:
                yield waking
            burst = copy.burst(node, to)
            if to == journey.datagram.to and not journey.ended.triggered:
                journey.datagram.last_hop = burst
            yield self._hops.send([burst])
            self._take_result(copy, burst, heard)
            if burst.acknowledged:
                break
            bursts += 1
            if burst.attempts:
                tried.add(to)
            else:
                yield self._env.timeout(self._pause * (1.0 + heard.uniform()))
        journey.end_copy()

    def _next(self, journey: Journey, node: int, heard: HeardPlaces, tried: set[int]) -> int | None:
        """The destination if it is within the nominal range, otherwise the best neighbour; None if none is nearer."""
        to, places = journey.datagram.to, self._nodes.assumed
        here, there = (places.x[node], places.y[node]), (places.x[to], places.y[to])
        near = to in heard.places or math.dist(here, there) <= self._nodes.reach
        return to if near and to not in tried else heard.best(here, there, tried | {to})

    def _take_result(self, copy: Copy, burst: Burst, heard: HeardPlaces) -> None:
        """Note what a burst says of its link; the receiver sends the copy on, if it has not had it."""
        copy.journey.datagram.bits += burst.sent
        copy.sequence = burst.sequence
        heard.links.note_sent(burst.to, burst.attempts, burst.acknowledged)
        if burst.packets:
            self._receive(copy.after(burst, self._env.now), burst)

    def _receive(self, copy: Copy, burst: Burst) -> None:
        journey, node = copy.journey, burst.to
        if node == journey.datagram.to:
            journey.arrive(node, burst, copy.hops)
            return
        heard = self._heard.get(node)
        key = journey.number, copy.mask.tobytes()
        if heard is not None and key not in heard.recent:
            heard.recent.append(key)
            self.send(copy, node)
