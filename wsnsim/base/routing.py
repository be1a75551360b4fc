"""The ports of routing: which path a datagram takes that leaves its cluster."""

from __future__ import annotations

from typing import Protocol


class Routing(Protocol):
    """The path of a datagram that leaves its cluster."""

    @property
    def weight(self) -> str:
        """What it minimises: 'energy' or 'hop'; or 'greedy': each hop goes nearest to the destination.

        Nodes know the paths for nothing. With 'etx' they pay for what they know: see `TreeRouting`.
        """


class TreeRouting(Routing, Protocol):
    """Routing over a collection tree, whose `weight` is 'etx': the expected number of transmissions.

    A member `largest_cost` is the cost from which on a route is not considered; without it, there is none.
    """

    @property
    def i_min(self) -> float:
        """The shortest interval of the Trickle timer of beacons in s."""

    @property
    def i_max(self) -> float:
        """The longest interval in s."""

    @property
    def retries(self) -> int:
        """How often a datagram is sent again over one hop, retransmissions of the MAC included."""

    @property
    def hysteresis(self) -> float:
        """By how many transmissions a route must be cheaper than that over the parent."""

    @property
    def table(self) -> int:
        """The number of neighbours whose routes a node keeps."""

    @property
    def queue(self) -> int:
        """The number of datagrams that a node holds."""

    @property
    def packet_time(self) -> float:
        """Seconds of one packet: pauses between frames are multiples of it."""

    @property
    def patience(self) -> float:
        """Seconds for which a datagram waits for a route."""

    @property
    def places(self) -> int:
        """The number of neighbours whose positions a node keeps."""

    @property
    def candidates(self) -> int:
        """The number of bursts that a node sends of a datagram to another node than a sink."""
