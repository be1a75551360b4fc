"""The frames, packets and operations that a tracker's requests would cost a network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import Broadcast, Compute, Gather, Local, Member, Parcel, Request, all_arrived


@dataclass
class RequestCosts:
    """Frames, packets and operations of all requests so far, and the measurements that entered the last flow."""

    frames: int = 0
    packets: int = 0
    cycles: float = 0.0
    readings: int = 0
    _counted_once: bool = False

    def before(self, request: Request) -> None:
        """Count what is known of a request before it is performed. A broadcast is one frame for all receivers."""
        self._counted_once = isinstance(request, Broadcast)
        if isinstance(request, Broadcast):
            self._add(request.parcel)
        elif isinstance(request, Compute):
            self.cycles += request.cycles

    def carry(self, source: int, to: int, parcel: Parcel) -> Bools:
        """Count a parcel; all of its packets arrive."""
        if not self._counted_once:
            self._add(parcel)
        return all_arrived(parcel.packets)

    def after(self, request: Request, answer: Any, members: dict[int, Member]) -> None:
        """Count what is known of a request once it is answered."""
        if isinstance(request, Local):
            cycles = request.cycles
            self.cycles += sum(cycles(members[node]) if callable(cycles) else cycles for node in answer)
            self.readings = sum(members[node].reading is not None for node in answer)
        elif isinstance(request, Gather):
            known = sum(payload is members[node].reading for node, (payload, _) in answer.items())
            self.readings = known or self.readings

    def _add(self, parcel: Parcel) -> None:
        self.frames += 1
        self.packets += parcel.packets
