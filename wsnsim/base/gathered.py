"""The answer to a `Gather`, which also says how long each parcel took and over how many hops it came."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from wsnsim.base.arrays import Bools

NOBODY: Final = -1


class Journeys(NamedTuple):
    """How parcels came to the head; its own take no time and no hop.

    Attributes:
        head: The head.
        seconds: What the parcels of all others took, over one hop.
        each: {id: (seconds, hops)} of each other, where they differ. None: they do not.
    """

    head: int = NOBODY
    seconds: float = 0.0
    each: Mapping[int, tuple[float, int]] | None = None

    def of(self, node: int) -> tuple[float, int]:
        """(seconds, hops) of the parcel of one node."""
        if node == self.head:
            return 0.0, 0
        return (self.seconds, 1) if self.each is None else self.each[node]


WITHIN_THE_INSTANT: Final = Journeys()
"""0 s and one hop, from every node."""


class Gathered(dict[int, tuple[Any, Bools]]):
    """{id: (payload, mask)} of what arrived at the head: the answer to `Gather`. A mask is (packets,).

    Args:
        arrived: What arrived.
        journeys: How the parcels came.
    """

    __slots__ = ("journeys",)

    def __init__(self, arrived: Mapping[int, tuple[Any, Bools]], journeys: Journeys = WITHIN_THE_INSTANT) -> None:
        super().__init__(arrived)
        self.journeys = journeys

    @property
    def delays(self) -> dict[int, float]:
        """{id: seconds from the request until the last packet of its parcel had arrived}; 0 for the head's own."""
        return {node: self.journeys.of(node)[0] for node in self}

    @property
    def hops(self) -> dict[int, int]:
        """{id: hops that its parcel took}; 0 for the head's own."""
        return {node: self.journeys.of(node)[1] for node in self}
