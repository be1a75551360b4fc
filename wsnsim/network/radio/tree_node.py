"""One node of a collection tree: what it heard of its neighbours' routes, its parent, and the cost of its route.

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
from math import inf, isfinite
from typing import Final, NamedTuple

from wsnsim.network.radio.link_estimator import LinkTable

NOBODY: Final = -1
WORST_LINK: Final = 5.0
"""ETX from which on a link is not used: one frame in five is acknowledged."""
LARGE_DROP: Final = 2.0
"""After a drop of the cost by more than this the node beacons soon."""


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
        changes: How often the parent changed.
    """

    __slots__ = ("_advertised", "_hysteresis", "_largest", "_root", "changes", "links", "node", "parent")

    def __init__(self, node: int, root: bool, links: LinkTable, hysteresis: float, largest: float = inf) -> None:
        self.node = node
        self._root = root
        self.links = links
        self._hysteresis = hysteresis
        self._largest = largest
        self._advertised: dict[int, tuple[int, float]] = {}
        self.parent = node if root else NOBODY
        self.changes = 0

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
        self.changes += 1
        if parent != NOBODY:
            self.links.pin(parent)

    def _over(self, neighbour: int) -> float:
        """The cost of the route over a neighbour; infinity if there is none, it leads back here or costs too much."""
        parent, cost = self._advertised.get(neighbour, (NOBODY, inf))
        total = inf if parent in (NOBODY, self.node) else cost + self.links.etx(neighbour)
        return total if total < self._largest else inf
