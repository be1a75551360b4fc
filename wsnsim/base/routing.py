"""The ports of routing: which path a datagram takes that leaves its cluster."""

from __future__ import annotations

from typing import Protocol


class Routing(Protocol):
    """The path of a datagram that leaves its cluster."""

    @property
    def weight(self) -> str:
        """What it minimises: 'energy' or 'hop'; or 'greedy': each hop goes nearest to the destination.

        Nodes know the paths for nothing. With 'etx' they pay for what they know, as in the collection tree protocol.
        """
