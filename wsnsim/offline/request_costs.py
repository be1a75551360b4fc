"""The frames, packets and operations that a tracker's requests would cost a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import (
    Broadcast,
    Compute,
    Gather,
    GatherReadings,
    Local,
    Member,
    Parcel,
    Request,
    all_arrived,
)
from wsnsim.offline.loopback import Lose, answer_to, perfect


@dataclass
class RequestCosts:
    """Frames, packets and operations of all requests so far, and the measurements that entered the last flow."""

    frames: int = 0
    packets: int = 0
    cycles: float = 0.0
    readings: int = 0
    _counted_once: bool = False
    _parcel_of: Callable[[Member], Parcel | None] = field(init=False)
    _sent: dict[int, int] = field(default_factory=dict)

    def answer(self, request: Request, members: dict[int, Member], head: int, lose: Lose) -> Any:
        """The answer to a request, whose measurements are counted without a call for each of them."""
        if not isinstance(request, GatherReadings):
            return answer_to(request, members, head, lose)
        answer = answer_to(request, members, head, perfect)
        sent = len(answer.ids) - (head in answer.ids)
        self.frames += sent
        self.packets += sent
        self.readings = len(answer.ids) or self.readings
        return answer

    def before(self, request: Request) -> None:
        """Count what is known of a request before it is performed. A broadcast is one frame for all receivers."""
        self._counted_once = isinstance(request, Broadcast)
        if isinstance(request, Broadcast):
            self._add(request.parcel)
        elif isinstance(request, Compute):
            self.cycles += request.cycles
        elif isinstance(request, Gather):
            self._sent, self._parcel_of, request.parcel_of = {}, request.parcel_of, self._note

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
            if request.uses_readings:
                self.readings = sum(members[node].reading is not None for node in answer)
        elif isinstance(request, Gather):
            request.parcel_of = self._parcel_of
            self.readings = sum(self._sent.get(node, 0) for node in answer) or self.readings

    def _note(self, member: Member) -> Parcel | None:
        """A member's parcel, whose readings are counted."""
        parcel = self._parcel_of(member)
        if parcel is not None:
            self._sent[member.id] = parcel.readings_of(member)
        return parcel

    def _add(self, parcel: Parcel) -> None:
        self.frames += 1
        self.packets += parcel.packets
