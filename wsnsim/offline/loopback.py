"""The smallest driver of a flow: a cluster on a table, no clock, no joules. It serves filters' tests and benches.

belief = perform(tracker.step(belief, scene), {member.id: member for member in members}, head, lose)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import (
    Ask,
    Broadcast,
    Compute,
    Delivery,
    Flow,
    Gather,
    Local,
    Member,
    Parcel,
    Scatter,
    all_arrived,
)

Lose = Callable[[int, int, Parcel], Bools]
"""(source, destination, parcel) → mask of the packets that arrive."""


def perfect(source: int, to: int, parcel: Parcel) -> Bools:
    """Everything arrives."""
    return all_arrived(parcel.packets)


def silent(source: int, to: int, parcel: Parcel) -> Bools:
    """Nothing arrives."""
    return np.zeros(parcel.packets, dtype=np.bool_)


def perform(
    flow: Flow[Any],
    members: dict[int, Member],
    head: int,
    lose: Lose = perfect,
    watch: Callable[[Ask], None] | None = None,
    close: Callable[[Ask, Any], None] | None = None,
) -> Any:
    """Drive a flow to its end and give its belief. `watch` sees every ask before, `close` every ask and its answer."""
    answer: Any = None
    while True:
        try:
            ask = flow.send(answer)
        except StopIteration as end:
            return end.value
        if watch:
            watch(ask)
        answer = answer_to(ask, members, head, lose)
        if close:
            close(ask, answer)


def answer_to(ask: Ask, members: dict[int, Member], head: int, lose: Lose) -> Any:
    """What a network that loses as `lose` says would answer."""
    if isinstance(ask, Compute):
        return None
    if isinstance(ask, Local):
        return _compute(ask, _addressed(ask.who, members))
    if isinstance(ask, Gather):
        parcels = {member.id: ask.parcel_of(member) for member in _addressed(ask.who, members)}
        masks = {i: _carry(i, head, parcel, lose) for i, parcel in parcels.items() if parcel is not None}
        return {i: (parcels[i].payload, mask) for i, mask in masks.items() if mask.any()}  # type: ignore[union-attr]
    if isinstance(ask, Scatter):
        return _deliver({i: parcel for i, parcel in ask.parcels.items() if i in members}, members, head, lose)
    if isinstance(ask, Broadcast):
        return _deliver({i: ask.parcel for i in members if i != head}, members, head, lose)
    return _carry(head, ask.to, ask.parcel, lose)


def _addressed(who: Any, members: dict[int, Member]) -> list[Member]:
    if who is None:
        return [member for member in members.values() if member.reading is not None]
    return [members[i] for i in who if i in members]


def _compute(ask: Local, addressed: list[Member]) -> tuple[int, ...]:
    if ask.work_all is not None and addressed:
        ask.work_all(addressed)
    else:
        for member in addressed:
            ask.work(member)
    return tuple(member.id for member in addressed)


def _carry(source: int, to: int, parcel: Parcel, lose: Lose) -> Bools:
    return all_arrived(parcel.packets) if source == to else lose(source, to, parcel)


def _deliver(parcels: dict[int, Parcel], members: dict[int, Member], head: int, lose: Lose) -> dict[int, Bools]:
    masks = {i: _carry(head, i, parcel, lose) for i, parcel in parcels.items()}
    heard = {i: mask for i, mask in masks.items() if mask.any()}
    for i, mask in heard.items():
        members[i].inbox.append(Delivery(parcels[i].what, parcels[i].payload, mask))
    return heard
