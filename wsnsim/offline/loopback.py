"""The smallest driver of a tracker's flow: it performs requests at once, without a clock and without energy.

belief = perform(tracker.step(belief, scene), {member.id: member for member in members}, head, lose)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import (
    Broadcast,
    Compute,
    Delivery,
    Flow,
    Gather,
    Gathered,
    GatheredReadings,
    GatherReadings,
    Journeys,
    Local,
    Member,
    NodeId,
    Parcel,
    Request,
    Scatter,
    all_arrived,
)

Lose: TypeAlias = Callable[[int, int, Parcel], Bools]
"""(source, destination, parcel) → mask of the packets that arrive."""
Answer: TypeAlias = Callable[[Request, dict[int, Member], int, Lose], Any]
"""(request, members, head, lose) → the answer to the request."""


def perfect(source: int, to: int, parcel: Parcel) -> Bools:
    """The mask of a lossless network: everything arrives."""
    return all_arrived(parcel.packets)


def silent(source: int, to: int, parcel: Parcel) -> Bools:
    """The mask of a silent network: nothing arrives."""
    return np.zeros(parcel.packets, dtype=np.bool_)


def perform(
    flow: Flow[Any],
    members: dict[int, Member],
    head: int,
    lose: Lose = perfect,
    before: Callable[[Request], None] | None = None,
    after: Callable[[Request, Any], None] | None = None,
    answer_of: Answer | None = None,
) -> Any:
    """Perform all requests of a flow; returns its belief.

    Args:
        flow: The flow of a tracker.
        members: Members of the cluster by id.
        head: Id of the cluster head.
        lose: Which packets arrive.
        before: Called with each request before it is performed.
        after: Called with each request and its answer.
        answer_of: Answers the requests; by default `answer_to`.
    """
    answer_of = answer_of or answer_to
    answer: Any = None
    while True:
        try:
            request = flow.send(answer)
        except StopIteration as end:
            return end.value
        if before:
            before(request)
        answer = answer_of(request, members, head, lose)
        if after:
            after(request, answer)


def answer_to(request: Request, members: dict[int, Member], head: int, lose: Lose) -> Any:
    """The answer to a request in a network that loses packets as `lose` says."""
    if isinstance(request, Compute):
        return None
    if isinstance(request, GatherReadings):
        return _gather_readings(request, members, head, lose)
    if isinstance(request, Local):
        return _compute(request, _addressed(request.who, members))
    if isinstance(request, Gather):
        return _gather(request, _addressed(request.who, members), head, lose)
    if isinstance(request, Scatter):
        return _deliver({i: parcel for i, parcel in request.parcels.items() if i in members}, members, head, lose)
    if isinstance(request, Broadcast):
        return _deliver({i: request.parcel for i in members if i != head}, members, head, lose)
    return _carry(head, request.to, request.parcel, lose)


def _addressed(who: Sequence[NodeId] | None, members: Mapping[int, Member]) -> list[Member]:
    if who is None:
        return [member for member in members.values() if member.reading is not None]
    return [members[i] for i in who if i in members]


def _compute(request: Local, addressed: list[Member]) -> tuple[int, ...]:
    if request.work_all is not None and addressed:
        request.work_all(addressed)
    else:
        for member in addressed:
            request.work(member)
    return tuple(member.id for member in addressed)


def _gather(request: Gather, addressed: list[Member], head: int, lose: Lose) -> Gathered:
    parcels = {member.id: request.parcel_of(member) for member in addressed}
    sent = {i: (parcel.payload, _carry(i, head, parcel, lose)) for i, parcel in parcels.items() if parcel is not None}
    return Gathered({i: (payload, mask) for i, (payload, mask) in sent.items() if mask.any()}, Journeys(head))


def _gather_readings(request: GatherReadings, members: dict[int, Member], head: int, lose: Lose) -> GatheredReadings:
    if lose is not perfect:
        return GatheredReadings.of(_gather(request.gather(), _addressed(request.who, members), head, lose))
    readings = request.readings_of(members.values() if request.who is None else _addressed(request.who, members))
    values = np.array(list(readings.values()), dtype=np.float64)
    return GatheredReadings(tuple(readings), values, Journeys(head))


def _carry(source: int, to: int, parcel: Parcel, lose: Lose) -> Bools:
    return all_arrived(parcel.packets) if source == to else lose(source, to, parcel)


def _deliver(parcels: dict[int, Parcel], members: dict[int, Member], head: int, lose: Lose) -> dict[int, Bools]:
    masks = {i: _carry(head, i, parcel, lose) for i, parcel in parcels.items()}
    heard = {i: mask for i, mask in masks.items() if mask.any()}
    for i, mask in heard.items():
        members[i].inbox.append(Delivery(parcels[i].what, parcels[i].payload, mask))
    return heard
