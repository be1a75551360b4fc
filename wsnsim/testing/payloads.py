"""What a parcel carries: plain values, for which its bits suffice.

A payload of k different real numbers needs at least 8 k bits, headers included. Positions and sensor constants of nodes
are known to all and free. An integer needs its own bits, and at least one; a truth value needs one, and a text eight a
character. The order of values that are free, and how often they are repeated, is not counted.
"""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Iterator, Mapping, Set
from typing import Any, Final

import numpy as np

from wsnsim.base.requests import Member, Parcel

BITS_A_NUMBER: Final = 8
"""The least bits of a real number (our choice): coarser than any quantisation that the papers count with."""


def plain(payload: Any) -> Any:
    """The payload as nested tuples of numbers, texts and arrays; all of it copied.

    Raises:
        AssertionError: It holds something that is no value: a `Member`, a function, an object with a state.
    """
    assert not isinstance(payload, Member), "a payload holds a live Member: send values that are read when it is sent"
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


def demand_enough_bits(parcel: Parcel, known: Set[float]) -> None:
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
