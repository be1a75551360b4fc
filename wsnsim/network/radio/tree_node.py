"""One node of a collection tree: what it heard of its neighbours' routes, its parent, its cost, and its beacons.

The cost of a route is the sum of the ETX of its links; that of a sink, the root of a tree, is 0. A node takes the
neighbour over which the route costs least, but leaves its parent only for one that is cheaper by `hysteresis`. A route
that costs `largest` or more is none: nodes that are cut off from all sinks form loops, whose costs only rise.

Source: Gnawali, Fonseca, Jamieson, Moss, Levis (2009), "Collection tree protocol", SenSys; TinyOS TEP 123; the rules of
TinyOS 2.1.2 (lib/net/ctp; older versions differ in the limit on links and in the beacon after a large drop). As
in TEP 123, and not as in TinyOS, only nodes with a route answer the pull bit. Ours: a node that lost its route beacons
soon; the route is chosen again whenever it may have changed, not every 8 s; a neighbour that says that it has no route
loses the one that it had; there is no congestion bit, which TinyOS switches off, too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf, isfinite
from typing import Final, NamedTuple

from wsnsim.base.frames import Received
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.models.workloads import BEACON_BITS
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import then
from wsnsim.network.radio.link_estimator import LinkTable
from wsnsim.network.radio.topology import RadioServices

NOBODY: Final = -1
WORST_LINK: Final = 5.0
"""ETX from which on a link is not used: one frame in five is acknowledged."""
LARGE_DROP: Final = 2.0
"""After a drop of the cost by more than this the node beacons soon."""
NUMBERS: Final = 256


class RouteBeacon(NamedTuple):
    """A routing beacon.

    Attributes:
        sender: Who sends it.
        number: Its number, modulo 256.
        parent: The sender's parent; the sender itself if it is a sink; NOBODY without a route.
        cost: The cost of the sender's route; infinity without a route.
        place: (x, y) where the sender assumes to stand, in m.
    """

    sender: int
    number: int
    parent: int
    cost: float
    place: tuple[float, float]

    @property
    def pull(self) -> bool:
        """Whether the sender has no route, and asks for beacons (the P bit)."""
        return self.parent == NOBODY


class TreeNode:
    """The route of one node.

    Args:
        node: The node.
        root: Whether it is a sink.
        links: Its links; nobody else changes them.
        hysteresis: By how much a route must be cheaper than that over the parent.
        largest: The cost from which on a route is not considered (TEP 123, section 3).

    Attributes:
        parent: The next hop; the node itself if it is a sink; NOBODY without a route.
    """

    __slots__ = ("_advertised", "_hysteresis", "_largest", "_root", "links", "node", "parent")

    def __init__(self, node: int, root: bool, links: LinkTable, hysteresis: float, largest: float = inf) -> None:
        self.node = node
        self._root = root
        self.links = links
        self._hysteresis = hysteresis
        self._largest = largest
        self._advertised: dict[int, tuple[int, float]] = {}
        self.parent = node if root else NOBODY

    @property
    def cost(self) -> float:
        """The cost of the route; infinity without one."""
        return 0.0 if self._root else self._over(self.parent)

    @property
    def has_route(self) -> bool:
        """Whether the node is a sink or has a parent."""
        return self.parent != NOBODY

    def hear(self, beacon: RouteBeacon, is_strong: Callable[[], bool]) -> None:
        """Take what a beacon says. `is_strong` tells whether its frame came in strong, and is asked if that matters."""
        sender = beacon.sender

        def displaces(other: int) -> bool:
            return beacon.cost < self._advertised.get(other, (NOBODY, inf))[1] and is_strong()

        known, evicted = self.links.hear(sender, beacon.number, displaces, force=beacon.parent == sender)
        if evicted is not None:
            self._advertised.pop(evicted, None)
        if known and beacon.parent != NOBODY:
            self._advertised[sender] = beacon.parent, beacon.cost
        else:
            self._advertised.pop(sender, None)

    def choose(self) -> bool:
        """Choose the parent; returns whether neighbours should know: the cost fell by much, or the route is lost.

        The first route counts as a large drop of the cost.
        """
        if self._root:
            return False
        before = self._over(self.parent)
        best = min(
            (node for node in self._advertised if node != self.parent and self.links.etx(node) < WORST_LINK),
            key=self._over, default=NOBODY,
        )  # fmt: skip
        cost = self._over(best)
        if cost + self._hysteresis < before or (isfinite(cost) and not isfinite(before)):
            self._take(best)
            return before - cost > LARGE_DROP
        if self.has_route and not isfinite(before):
            self._take(NOBODY)
            return True
        return False

    def _take(self, parent: int) -> None:
        """Change the parent; sinks in range stay in the table in any case."""
        if self.parent != NOBODY and self._advertised.get(self.parent, (NOBODY, inf))[0] != self.parent:
            self.links.unpin(self.parent)
        self.parent = parent
        if parent != NOBODY:
            self.links.pin(parent)

    def _over(self, neighbour: int) -> float:
        """The cost of the route over a neighbour; infinity if there is none, it leads back here or costs too much."""
        parent, cost = self._advertised.get(neighbour, (NOBODY, inf))
        total = inf if parent in (NOBODY, self.node) else cost + self.links.etx(neighbour)
        return total if total < self._largest else inf


class TrickleTimer:
    """The Trickle timer of one node.

        timer.begin() -> s until `advance`      timer.advance() -> (transmit now?, s until the next `advance`)

    It knows no clock: the caller counts the seconds. No transmission is suppressed (k is infinite). Names in brackets
    are those of the RFC, section 4.

    Args:
        shortest: The shortest interval in s (Imin).
        longest: The longest interval in s (Imax; the RFC gives it as a number of doublings).
        uniform: Returns a random number in [0, 1).

    Attributes:
        interval: The present interval in s (I).
    """

    def __init__(self, shortest: float, longest: float, uniform: Callable[[], float]) -> None:
        self._shortest = shortest
        self._longest = longest
        self._uniform = uniform
        self._rest = 0.0
        self._transmits = False
        self.interval = shortest

    def begin(self) -> float:
        """Start the shortest interval; returns the seconds until `advance` is due."""
        self.interval = self._shortest
        return self._start()

    def advance(self) -> tuple[bool, float]:
        """Do what is due: half of the calls are about a transmission, the others end an interval.

        Returns:
            Whether to transmit now, and the seconds until `advance` is due again.
        """
        if self._transmits:
            self._transmits = False
            return True, self._rest
        self.interval = min(2.0 * self.interval, self._longest)
        return False, self._start()

    def reset(self) -> float | None:
        """Start the shortest interval because something is inconsistent, unless the timer is in one.

        Returns:
            The seconds until `advance` is due, in place of what was said before; None: that still holds.
        """
        return self.begin() if self.interval > self._shortest else None

    def _start(self) -> float:
        """Begin an interval: transmit at a random time of its second half (t)."""
        until = 0.5 * self.interval * (1.0 + self._uniform())
        self._rest, self._transmits = self.interval - until, True
        return until


Compose = Callable[[int, int], RouteBeacon]
"""(node, number) -> the beacon that the node sends now."""


class _BeaconSender:
    """The timer of one node, the number of its next beacon, and whether one is waiting or on the air.

    `epoch` counts how often the timer was set: of several times, the last counts.
    """

    __slots__ = ("epoch", "number", "sending", "timer")

    def __init__(self, timer: TrickleTimer) -> None:
        self.timer = timer
        self.epoch = 0
        self.number = 0
        self.sending = False


class RouteBeacons:
    """The beacons of all nodes. A node that sleeps when its beacon is due leaves it out.

    Args:
        radio: The services of the radio.
        mac: The MAC.
        clocks: The clocks of the nodes, which the timers follow.
        compose: Composes a beacon.
        heard: Called with each receiver of a beacon, ascending, and the beacon.

    Attributes:
        sent: The number of beacons that nodes tried to send.
    """

    def __init__(
        self, radio: RadioServices, mac: MacMechanism, clocks: Clocks, compose: Compose,
        heard: Callable[[int, RouteBeacon], None],
    ) -> None:  # fmt: skip
        self._env = radio.env
        self._nodes = radio.nodes
        self._mac = mac
        self._clocks = clocks
        self._compose = compose
        self._heard = heard
        self._code = radio.log.code("routing_beacon")
        self._senders: dict[int, _BeaconSender] = {}
        self.sent = 0

    def begin(self, node: int, timer: TrickleTimer) -> None:
        """Start the timer of a node."""
        sender = self._senders[node] = _BeaconSender(timer)
        self._set(node, sender, timer.begin())

    def end(self, node: int) -> None:
        """Stop the timer of a node that is down."""
        self._senders.pop(node, None)

    def hasten(self, node: int) -> None:
        """Start the shortest interval of a node: its neighbours should hear from it soon."""
        sender = self._senders.get(node)
        seconds = None if sender is None else sender.timer.reset()
        if sender is not None and seconds is not None:
            self._set(node, sender, seconds)

    def _set(self, node: int, sender: _BeaconSender, seconds: float) -> None:
        sender.epoch += 1
        timeout = self._env.timeout(self._clocks.lasts(node, seconds))
        then(timeout, self._due, node, sender, sender.epoch)

    def _due(self, node: int, sender: _BeaconSender, epoch: int) -> None:
        if self._senders.get(node) is not sender or sender.epoch != epoch:
            return
        transmit, seconds = sender.timer.advance()
        self._set(node, sender, seconds)
        if transmit and not sender.sending and self._nodes.is_awake(node):
            self._send(node, sender)

    def _send(self, node: int, sender: _BeaconSender) -> None:
        beacon = self._compose(node, sender.number)
        if self._senders.get(node) is not sender:
            return
        sender.number = (sender.number + 1) % NUMBERS
        sender.sending = True
        self.sent += 1
        self._mac.offer(node, BEACON_BITS, partial(self._sent, sender, beacon), self._code)

    def _sent(self, sender: _BeaconSender, beacon: RouteBeacon, received: Received | None) -> None:
        sender.sending = False
        for node in () if received is None else received.tolist():
            self._heard(node, beacon)
