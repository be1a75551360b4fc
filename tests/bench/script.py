"""A tracker that replays another's asks with no mathematics: what is left is the price of the seam and of the network.

script = Script(); simulate with Recorded(tracker, script); then simulate with Replayed(tracker, script)
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import Broadcast, Gather, Local, Member, Parcel, Request, Scatter, Send


@dataclass
class Script:
    """Flows in the order in which they were performed, each the asks it made; and what was estimated and forecast."""

    flows: list[list[Request]] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    forecasts: list[Estimate] = field(default_factory=list)


class Recorded:
    """Does what a tracker does, and writes down its asks without their mathematics."""

    def __init__(self, tracker: Any, script: Script) -> None:
        self._tracker = tracker
        self._script = script

    def start(self, prior: Any, scene: Any) -> Any:
        return self._watch(self._tracker.start(prior, scene))

    def step(self, belief: Any, scene: Any) -> Any:
        return self._watch(self._tracker.step(belief, scene))

    def hand_over(self, belief: Any, scene: Any, successor: int) -> Any:
        return self._watch(self._tracker.hand_over(belief, scene, successor))

    def estimate(self, belief: Any) -> Estimate:
        self._script.estimates.append(self._tracker.estimate(belief))
        return self._script.estimates[-1]

    def forecast(self, belief: Any, scene: Any, ahead: int) -> Estimate:
        self._script.forecasts.append(self._tracker.forecast(belief, scene, ahead))
        return self._script.forecasts[-1]

    def _watch(self, flow: Generator[Request, Any, Any]) -> Generator[Request, Any, Any]:
        asks: list[Request] = []
        self._script.flows.append(asks)
        answer: Any = None
        while True:
            try:
                ask = flow.send(answer)
            except StopIteration as end:
                return end.value
            copy, noted = _noted(ask)
            answer = yield noted
            asks.append(copy)


class Replayed:
    """Makes the asks of a script, in order, and gives its estimates."""

    def __init__(self, script: Script) -> None:
        self._flows = iter(script.flows)
        self._estimates: Iterator[Estimate] = iter(script.estimates)
        self._forecasts: Iterator[Estimate] = iter(script.forecasts)

    def start(self, prior: Any, scene: Any) -> Any:
        return self._replay()

    def step(self, belief: Any, scene: Any) -> Any:
        return self._replay()

    def hand_over(self, belief: Any, scene: Any, successor: int) -> Any:
        return self._replay()

    def estimate(self, belief: Any) -> Estimate:
        return next(self._estimates)

    def forecast(self, belief: Any, scene: Any, ahead: int) -> Estimate:
        return next(self._forecasts)

    def _replay(self) -> Generator[Request, Any, Any]:
        yield from (ask for ask in next(self._flows))
        return True


def _noted(ask: Request) -> tuple[Any, Request]:
    """A copy of an ask that does nothing, filled in while the ask itself is performed."""
    if isinstance(ask, Local):
        return _noted_local(ask)
    if isinstance(ask, Gather):
        return _noted_gather(ask)
    if isinstance(ask, Scatter):
        return Scatter({node: _empty(parcel) for node, parcel in ask.parcels.items()}), ask
    if isinstance(ask, Broadcast):
        return Broadcast(_empty(ask.parcel)), ask
    if isinstance(ask, Send):
        return Send(ask.to, _empty(ask.parcel)), ask
    return ask, ask


def _noted_local(ask: Local) -> tuple[Local, Local]:
    cycles: dict[int, float] = {}

    def ask_and_note(member: Member) -> float:
        cycles[member.id] = ask.cycles(member) if callable(ask.cycles) else ask.cycles
        return cycles[member.id]

    copy = Local(work=lambda member: None, work_all=lambda members: None, cycles=lambda m: cycles[m.id])
    return replace(copy, who=ask.who, uses_readings=ask.uses_readings), replace(ask, cycles=ask_and_note)


def _noted_gather(ask: Gather) -> tuple[Gather, Gather]:
    parcels: dict[int, Parcel | None] = {}

    def ask_and_note(member: Member) -> Parcel | None:
        parcel = ask.parcel_of(member)
        parcels[member.id] = None if parcel is None else _empty(parcel)
        return parcel

    return Gather(lambda member: parcels[member.id], ask.who, ask.deadline), Gather(ask_and_note, ask.who, ask.deadline)


def _empty(parcel: Parcel) -> Parcel:
    return Parcel(None, parcel.packets, parcel.packet_bits, parcel.what)
