"""The values of nested mappings by dotted key, and those in which two mappings differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

ABSENT: Final = "(absent)"


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of every value that is not a mapping."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for number, inner in enumerate(value):
            yield from leaves(inner, f"{path}.{number}")
    else:
        yield path, value


def differing_leaves(a: Mapping[str, Any], b: Mapping[str, Any], but: Sequence[str] = ()) -> dict[str, tuple[Any, Any]]:
    """{dotted key: (A, B)} of the values that differ; what only one of them has is `ABSENT` in the other."""
    sides = [dict(leaves(dict(each))) for each in (a, b)]
    keys = [*sides[0], *(key for key in sides[1] if key not in sides[0])]
    pairs = {key: (sides[0].get(key, ABSENT), sides[1].get(key, ABSENT)) for key in keys if key not in but}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}
