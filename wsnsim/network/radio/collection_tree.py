"""Collection that is paid: routing over a collection tree to sinks, by geographic forwarding to all other nodes.

Nodes know of each other what they heard. A network starts without a tree, and every beacon, datagram, retransmission
and acknowledgement that makes and uses one is on the air, paid and logged. See `tree_node` for the choice of routes
and for when beacons are sent, `link_estimator` for the costs of links, `TreeQueue` for how datagrams go up
the tree, `geographic_forwarding` for datagrams to other nodes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.frames import Burst
from wsnsim.models.workloads import CollectionTreeProtocol
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import then
from wsnsim.network.radio.datagrams import A_SINK, Copy, Datagram, Hops, Journey, node_random
from wsnsim.network.radio.geographic_forwarding import GeographicForwarding, HeardPlaces
from wsnsim.network.radio.link_estimator import LinkTable
from wsnsim.network.radio.radio_stack import RadioStack
from wsnsim.network.radio.tree_node import NOBODY, RouteBeacon, RouteBeacons, TreeNode, TrickleTimer

REMEMBERED: Final = 4
"""Datagrams that a node remembers after it has sent them on."""
MOST_HOPS: Final = 255
"""Hops after which a datagram is dropped: their number, THL, is one byte."""
SHORT: Final = 1.0
"""A pause lasts for one to two times this many packet times after a frame."""
LONG: Final = 4.0
"""The same after a frame that never got the channel, and where a loop is suspected."""
TREE_HEADER: Final = 64
"""Bits of the header of a data frame: options 8, THL 8, cost 16, origin 16, number 8, type 8 (TEP 123)."""
PLACE_HEADER: Final = 80
"""Bits of the header of a datagram by position: origin 16, number 8, hops 8, destination 16 and its position 32."""
STRONG: Final = 0.9
"""Reception probability from which on a frame came in strong, as the radio's link quality indicator tells (ours)."""


class TreeQueue:
    """The datagrams that one node sends on.

    A datagram that is not acknowledged is sent again, at most `retries` times, to whoever is the parent then. After
    each transmission the node pauses. Every frame carries the cost of its sender's route, which must fall from hop to
    hop: a node whose route does not cost less than the sender's suspects a loop. It then beacons soon, and pauses for
    longer before it goes on. A copy that a node has had before is dropped.

    Source: Gnawali, Fonseca, Jamieson, Moss, Levis (2009), "Collection tree protocol", SenSys; the pauses, in multiples
    of the time of a packet, and the number of remembered datagrams are those of TinyOS 2.1 (lib/net/ctp). Ours:
    retransmissions of the MAC count, and a datagram waits for a route for a limited time.
    """

    def __init__(
        self, env: simpy.Environment, route: TreeNode, routing: CollectionTreeProtocol, network: CollectionTree,
        hops: Hops, clocks: Clocks, uniform: Callable[[], float],
    ) -> None:  # fmt: skip
        self._env = env
        self._route = route
        self._routing = routing
        self._packet_time = clocks.lasts(route.node, routing.packet_time)
        self._patience = clocks.lasts(route.node, routing.patience)
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
        if len(self._copies) >= self._routing.queue:
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
            given_up = first.since + self._patience
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
        then(self._env.timeout(seconds), self._wake, self._timer)

    def _wake(self, timer: int) -> None:
        if timer == self._timer:
            self.resume()

    def _send(self, copy: Copy) -> None:
        to, cost = self._route.parent, self._route.cost
        burst = copy.burst(self._route.node, to)
        self._in_flight = copy
        then(self._hops.send([burst]), self._sent, copy, burst, cost)

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
        elif copy.tries > self._routing.retries:
            self._drop(self._copies.popleft(), "retry_limit")
        self._pause(SHORT if burst.attempts else LONG)
        self.resume()

    def _pause(self, packet_times: float) -> None:
        """Do not send for one to two times this number of packet times."""
        seconds = packet_times * self._packet_time * (1.0 + self._uniform())
        self._free_at = max(self._free_at, self._env.now + seconds)

    def _drop(self, copy: Copy, reason: str) -> None:
        journey = copy.journey
        if journey.is_last_copy:
            self._hops.drop(journey.datagram, self._route.node, journey.target, reason, copy.sequence)
        journey.end_copy()


class _TreeMember(NamedTuple):
    """What one node that is up knows and does."""

    route: TreeNode
    queue: TreeQueue
    places: HeardPlaces


class CollectionTree:
    """The collection tree protocol of all nodes, and their geographic forwarding: `datagrams.Forwarding`.

    Args:
        stack: The radio stack.
        hops: How bursts cross one hop.
        routing: The parameters.
        sinks: The roots of the trees.
        key: The random key of the nodes' timers and pauses.

    Attributes:
        beacons: The beacons of the nodes.
    """

    def __init__(
        self, stack: RadioStack, hops: Hops, routing: CollectionTreeProtocol, sinks: Sequence[int], key: int
    ) -> None:
        radio = stack.radio
        self._env, self._nodes, self._topology, *_ = radio
        self._clocks = stack.clocks
        self._hops = hops
        self._routing = routing
        self._sinks = frozenset(sinks)
        self._key = key
        self._journeys = 0
        self._members: dict[int, _TreeMember] = {}
        self._places: dict[int, HeardPlaces] = {}
        self._geographic = GeographicForwarding(
            radio, hops, self._places, routing.candidates, LONG * routing.packet_time
        )  # fmt: skip
        self.beacons = RouteBeacons(radio, stack.mac, stack.clocks, self._compose, self._hear)

    def start(self) -> None:
        """Start the timers of all nodes that are up."""
        for node in np.flatnonzero(self._nodes.living).tolist():
            self._begin(node)

    def sink_of(self, source: int) -> int:
        """The node itself if it is a sink; otherwise its datagram goes up the tree."""
        return source if source in self._sinks else A_SINK

    def is_one_hop(self, source: int, to: int) -> bool:
        """No: nodes do not know whom they reach; they try, and acknowledgements tell."""
        return False

    def forward(self, datagram: Datagram, target: int) -> simpy.Event:
        """Send a datagram up the tree, or to the node that it names."""
        self._journeys += 1
        upwards = datagram.to == A_SINK
        header = TREE_HEADER if upwards else PLACE_HEADER
        journey = Journey(self._env, datagram, target, self._journeys, header)
        copy = Copy(journey, 0, datagram.mask, datagram.parcel.packets, 0, self._env.now)
        member = self._members.get(datagram.source)
        if member is None:
            journey.add_copy()
            journey.end_copy()
        elif upwards:
            member.queue.add(copy)
        else:
            self._geographic.send(copy, datagram.source)
        return journey.ended

    def remove(self, node: int) -> None:
        """A node is down: it forgets all it knew, and the datagrams that it held are lost."""
        self.beacons.end(node)
        self._places.pop(node, None)
        member = self._members.pop(node, None)
        if member is not None:
            member.queue.stop()

    def restore(self, node: int) -> None:
        """A node is up again: it starts without a route."""
        if self._nodes.alive[node] and node not in self._members:
            self._begin(node)

    def forget_links(self) -> None:
        """Do nothing: nodes notice that links have changed by the frames that are lost."""

    def parent(self, node: int) -> int:
        """The next hop of a node; the node itself if it is a sink; NOBODY without a route, or if it is down."""
        return self._members[node].route.parent if node in self._members else NOBODY

    def cost(self, node: int) -> float:
        """The cost of the route of a node that is up; infinity without one."""
        return self._members[node].route.cost

    def receive(self, node: int, copy: Copy, cost: float, burst: Burst) -> None:
        """A node has received a copy, from one whose route costs `cost`: it arrives, or goes on, unless it was here."""
        member = self._members.get(node)
        if member is None or member.queue.knows(copy):
            return
        if node in self._sinks:
            member.queue.remember(copy)
            copy.journey.arrive(node, burst, copy.hops)
            return
        if cost <= member.route.cost and member.route.has_route:
            self.beacons.hasten(node)
            member.queue.suspect_loop()
        member.queue.add(copy)

    def note_sent(self, node: int, to: int, burst: Burst) -> None:
        """Note what a burst says of its link; a node whose frame was not acknowledged chooses its route again."""
        member = self._members[node]
        member.route.links.note_sent(to, burst.attempts, burst.acknowledged)
        if not burst.acknowledged:
            self._choose(node, member)

    def _begin(self, node: int) -> None:
        routing, uniform = self._routing, node_random(self._key, node)
        route = TreeNode(
            node, node in self._sinks, LinkTable(routing.table, uniform), routing.hysteresis, routing.largest_cost
        )
        queue = TreeQueue(self._env, route, routing, self, self._hops, self._clocks, uniform)
        places = self._places[node] = HeardPlaces(routing.places, uniform)
        self._members[node] = _TreeMember(route, queue, places)
        self.beacons.begin(node, TrickleTimer(routing.i_min, routing.i_max, uniform))

    def _compose(self, node: int, number: int) -> RouteBeacon:
        """The beacon that a node sends now: it first chooses its route again."""
        member, assumed = self._members[node], self._nodes.assumed
        self._choose(node, member)
        route = member.route
        return RouteBeacon(node, number, route.parent, route.cost, (assumed.x[node], assumed.y[node]))

    def _hear(self, node: int, beacon: RouteBeacon) -> None:
        """A node has received a beacon."""
        member = self._members.get(node)
        if member is None:
            return
        member.places.hear(beacon.sender, beacon.number, beacon.place)
        member.route.hear(beacon, lambda: self._topology.probability(beacon.sender, node, self._env.now) >= STRONG)
        self._choose(node, member)
        if beacon.pull and member.route.has_route:
            self.beacons.hasten(node)

    def _choose(self, node: int, member: _TreeMember) -> None:
        """Let a node choose its route. Neighbours hear of large changes soon; datagrams go on over a first route."""
        before = member.route.parent
        if member.route.choose():
            self.beacons.hasten(node)
        if before == NOBODY and member.route.has_route:
            member.queue.resume()
