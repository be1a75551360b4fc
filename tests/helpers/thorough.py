"""What `make thorough` adds to `make test`: expensive tests, and more seeds, examples and combinations.

@pytest.mark.thorough                                    a test that costs more than one of the fast tier may
@pytest.mark.thorough(fast=["ekf", "pf-csma"])           the same, except these cases of its parameters
@pytest.mark.parametrize("seed", [0, 1, *thorough(range(2, 10))])
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import pytest

THOROUGH = bool(os.environ.get("WSNSIM_THOROUGH"))
"""Whether properties are tested with as many examples as `make thorough` does."""


def thorough(values: Iterable[Any]) -> list[Any]:
    """Values of a parameter that are tested by `make thorough` alone."""
    return [pytest.param(value, marks=pytest.mark.thorough) for value in values]


def first(count: int, values: Sequence[Any]) -> list[Any]:
    """Values of a parameter; those after the first ones are tested by `make thorough` alone."""
    return [*values[:count], *thorough(values[count:])]


def keep_fast_cases(items: Iterable[pytest.Item]) -> set[str]:
    """Take the mark `thorough` from the cases that it names as fast; return those that were not found."""
    unknown: dict[str, set[str]] = {}
    for item in items:
        mark = next((mark for mark in item.own_markers if mark.name == "thorough" and mark.kwargs), None)
        if mark is not None:
            test, _, case = item.nodeid.partition("[")
            cases = unknown.setdefault(test, set(mark.kwargs["fast"]))
            if case[:-1] in cases:
                item.own_markers.remove(mark)
                cases.discard(case[:-1])
    return {f"{test}[{case}]" for test, cases in unknown.items() for case in cases}
