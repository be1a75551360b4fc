"""What `make thorough` adds to `make test`: more seeds, more examples and more combinations of what is tested there.

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
