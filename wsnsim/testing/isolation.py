"""A network for checks in which nodes share nothing but parcels, and which can repeat what arrived at the head.

    record = Isolation(table.known)                        closures work on copies, payloads are copied
    list(track(tracker, table, answer=record.answer))
    again = Isolation(table.known, record.gathered, altered)
    list(track(tracker, other_table, answer=again.answer))

The second run has other readings at the nodes `altered`; what arrives at the head is that of the first run. Nothing
that the head believes and nothing that the other nodes send may change.

`demand_enough_bits` says what a parcel may carry: plain values, for which its bits suffice.
A payload of k different real numbers needs at least 8 k bits, headers included. Positions and sensor constants of nodes
are known to all and free. An integer needs its own bits, and at least one; a truth value needs one, and a text eight a
character. The order of values that are free, and how often they are repeated, is not counted.
"""

from __future__ import annotations

import copy
import dataclasses
import numbers
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wsnsim.base import requests
from wsnsim.offline.loopback import Lose, answer_to
from wsnsim.testing.privacy import same

BITS_A_NUMBER: Final = 8
"""The least bits of a real number (our choice): coarser than any quantisation that the papers count with."""


def plain(payload: Any) -> Any:
    """The payload as nested tuples of numbers, texts and arrays; all of it copied.

    Raises:
        AssertionError: It holds something that is no value: a `Member`, a function, an object with a state.
    """
    assert not isinstance(payload, requests.Member), (
        "a payload holds a live Member: send values that are read when it is sent"
    )
    if payload is None or isinstance(payload, bool | np.bool_ | numbers.Number | str | bytes):
        return payload
    if isinstance(payload, np.ndarray) and payload.dtype.kind in "biufc":
        return payload.copy()
    if isinstance(payload, Mapping):
        return tuple((plain(key), plain(value)) for key, value in payload.items())
    if isinstance(payload, tuple | list):
        return tuple(plain(value) for value in payload)
    if isinstance(payload, Set):
        return tuple(plain(value) for value in sorted(payload))
    assert dataclasses.is_dataclass(payload) and not isinstance(payload, type), (
        f"a payload holds a {type(payload).__name__}, which is not a value: send numbers, arrays, tuples, mappings or "
        "dataclasses of them"
    )
    return tuple(plain(getattr(payload, each.name)) for each in dataclasses.fields(payload))


def demand_enough_bits(parcel: requests.Parcel, known: Set[float]) -> None:
    """Assert that a parcel has the bits that its payload needs; `known`: numbers that every node knows."""
    needed = _bits(plain(parcel.payload), known)
    declared = parcel.packets * parcel.packet_bits
    assert declared >= needed, (
        f"parcel {parcel.what!r} declares {declared} bits; what it carries needs at least {needed} "
        f"({BITS_A_NUMBER} for each different real number)"
    )


def _bits(payload: Any, known: Set[float]) -> int:
    leaves = list(_leaves(payload))
    real = {leaf for leaf in leaves if isinstance(leaf, float) and leaf == leaf and leaf not in known}
    whole = sum(max(leaf.bit_length(), 1) for leaf in leaves if isinstance(leaf, int))
    texts = [leaf for leaf in leaves if isinstance(leaf, str | bytes)]
    return BITS_A_NUMBER * len(real) + whole + 8 * sum(map(len, texts))


def _leaves(payload: Any) -> Iterator[float | int | str | bytes]:
    """All numbers and texts of a `plain` payload."""
    if isinstance(payload, tuple):
        for value in payload:
            yield from _leaves(value)
    elif isinstance(payload, np.ndarray):
        yield from _leaves(tuple(payload.ravel().tolist()))
    elif isinstance(payload, str | bytes):
        yield payload
    elif isinstance(payload, numbers.Integral | np.bool_):
        yield int(payload)
    elif isinstance(payload, numbers.Real):
        yield float(payload)
    elif isinstance(payload, numbers.Complex):
        yield from (float(payload.real), float(payload.imag))


@dataclass
class GatherRecord:
    """One performed Gather: the plain parcels that members made, and the answer that the head got."""

    parcels: dict[int, Any]
    answer: dict[int, Any]


class Isolation:
    """Answers requests like `answer_to`, but members' functions see copies, and what is sent is copied.

    Args:
        known: Numbers that every node knows, such as positions.
        pinned: What was gathered in an earlier run; the head gets it again. None: this run's own parcels arrive.
        altered: Nodes whose readings are not those of the earlier run.

    Attributes:
        gathered: What was gathered in this run.
    """

    def __init__(
        self, known: Set[float], pinned: Sequence[GatherRecord] | None = None, altered: Set[int] = frozenset()
    ) -> None:
        self._known = known
        self._pinned = pinned
        self._altered = altered
        self.gathered: list[GatherRecord] = []

    def answer(self, request: requests.Request, members: dict[int, requests.Member], head: int, lose: Lose) -> Any:
        """The answer to a request.

        Raises:
            AssertionError: A payload is no value or has too few bits, or a node that is not altered sends other things.
        """
        if isinstance(request, requests.Local):
            computed = answer_to(self._on_copies(request), members, head, lose)
            cycles = request.cycles
            if callable(cycles):
                for node in computed:
                    cycles(copy.deepcopy(members[node]))
            return computed
        if isinstance(request, requests.Gather):
            return self._gather(request, members, head, lose)
        if isinstance(request, requests.GatherReadings):
            return requests.GatheredReadings.of(self._gather(request.gather(), members, head, lose))
        if isinstance(request, requests.Scatter):
            parcels = {node: self._copied(parcel) for node, parcel in request.parcels.items()}
            return self._deliver(replace(request, parcels=parcels), members, head, lose)
        if isinstance(request, requests.Broadcast | requests.Send):
            return self._deliver(replace(request, parcel=self._copied(request.parcel)), members, head, lose)
        return answer_to(request, members, head, lose)

    def _on_copies(self, request: requests.Local) -> requests.Local:
        """A Local whose functions work on copies of members, from which the results are taken over."""
        work_all = request.work_all

        def all_on_copies(members: list[requests.Member]) -> None:
            assert work_all is not None, "it is called where there is a function for all"
            twins = [copy.deepcopy(member) for member in members]
            work_all(twins)
            for member, twin in zip(members, twins, strict=True):
                _take_over(member, twin)

        return replace(request, work=_on_copy(request.work), work_all=all_on_copies if work_all else None)

    def _gather(
        self, request: requests.Gather, members: dict[int, requests.Member], head: int, lose: Lose
    ) -> dict[int, Any]:
        parcels: dict[int, Any] = {}
        parcel_on_copy = _on_copy(request.parcel_of)

        def parcel_of(member: requests.Member) -> requests.Parcel | None:
            parcel = parcel_on_copy(member)
            if parcel is None:
                return None
            sent = self._copied(parcel, own=member.id == head)
            parcels[member.id] = (plain(sent.payload), sent.packets, sent.packet_bits)
            return sent

        answer: dict[int, Any] = answer_to(replace(request, parcel_of=parcel_of), members, head, lose)
        if self._pinned is not None:
            answer = self._repeat(parcels)
        self.gathered.append(GatherRecord(parcels, copy.deepcopy(answer)))
        return answer

    def _repeat(self, parcels: dict[int, Any]) -> dict[int, Any]:
        """The answer of the earlier run; nodes that are not altered must have made the same parcels."""
        assert self._pinned is not None and len(self.gathered) < len(self._pinned), (
            "the head requests other things although the same arrived: it used readings that were not sent to it"
        )
        earlier = self._pinned[len(self.gathered)]
        for node in (parcels.keys() | earlier.parcels.keys()) - self._altered:
            assert same(parcels.get(node, ()), earlier.parcels.get(node, ())), (
                f"what node {node} sends depends on readings of other nodes that it never received"
            )
        return copy.deepcopy(earlier.answer)

    def _deliver(self, request: requests.Request, members: dict[int, requests.Member], head: int, lose: Lose) -> Any:
        """The answer to a request of the head; each receiver gets a copy of its own."""
        answer = answer_to(request, members, head, lose)
        for node in answer if isinstance(answer, dict) else ():
            inbox = members[node].inbox
            inbox[-1] = copy.deepcopy(inbox[-1])
        return answer

    def _copied(self, parcel: requests.Parcel, own: bool = False) -> requests.Parcel:
        """The parcel with a copied payload. A head's own parcel is not sent and needs no bits."""
        if own:
            plain(parcel.payload)
        else:
            demand_enough_bits(parcel, self._known)
        return replace(parcel, payload=copy.deepcopy(parcel.payload))


def _on_copy(function: Callable[[requests.Member], Any]) -> Callable[[requests.Member], Any]:
    """A function that works on a copy of a member, from which the results are taken over."""

    def on_copy(member: requests.Member) -> Any:
        twin = copy.deepcopy(member)
        result = function(twin)
        _take_over(member, twin)
        return result

    return on_copy


def _take_over(member: requests.Member, twin: requests.Member) -> None:
    member.inbox, member.memory = copy.deepcopy((twin.inbox, twin.memory))
