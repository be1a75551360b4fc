"""Unicasts that are sent at one instant, each over one hop, as lists: without an object for each while all arrive."""

from __future__ import annotations

from dataclasses import dataclass, field

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import Burst, full_burst
from wsnsim.base.requests import Parcel, all_arrived


@dataclass(slots=True)
class Unicasts:
    """Parcels that are sent in this order, one from each source to its destination.

    Attributes:
        sources, destinations, parcels: Lists of equal length.
        target: The target that they are about; -1 for none.
        bursts: The bursts with what arrived, if they had to be performed one by one. None: everything arrived.
    """

    sources: list[int]
    destinations: list[int]
    parcels: list[Parcel]
    target: int
    bursts: list[Burst] | None = field(default=None, init=False)

    def split(self) -> list[Burst]:
        """Make one burst of each; they hold the results from now on."""
        triples = zip(self.sources, self.destinations, self.parcels, strict=True)
        self.bursts = [full_burst(source, to, parcel, self.target) for source, to, parcel in triples]
        return self.bursts

    @property
    def bits(self) -> int:
        """Bits that left the senders."""
        if self.bursts is not None:
            return sum(burst.sent for burst in self.bursts)
        return sum(parcel.packets * parcel.packet_bits for parcel in self.parcels)

    def masks(self) -> list[Bools | None]:
        """Which packets of each parcel arrived, (packets,); None where nothing did."""
        if self.bursts is None:
            return [all_arrived(parcel.packets) for parcel in self.parcels]
        return [burst.mask if burst.packets else None for burst in self.bursts]
