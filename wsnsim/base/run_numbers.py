"""The numbers of Monte Carlo runs, from what a caller gives.

run_numbers(3) -> [0, 1, 2]        run_numbers([4, 7]) -> [4, 7]
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, Final

from wsnsim.base.errors import UsageError

MOST: Final = 2**32 - 1
"""The largest number of a run that a table holds."""
ALLOWED: Final = "a number of runs from 1, or a list of different run numbers"


def run_number(value: Any, argument: str = "replicate") -> int:
    """Return the number of a run. Raises UsageError if it is no whole number from 0."""
    number = _whole(value)
    if number is None or not 0 <= number <= MOST:
        raise UsageError(f"{argument}: expected the number of a run, a whole number from 0, got {value!r:.80}")
    return number


def run_count(value: Any, argument: str = "replicates") -> int:
    """Return a number of runs. Raises UsageError if it is no whole number from 1."""
    number = _whole(value)
    if number is None:
        raise UsageError(f"{argument}: expected a number of runs from 1, got {value!r:.80}")
    if not 1 <= number <= MOST:
        raise UsageError(f"{argument}: must be at least 1 and at most {MOST}, is {number}")
    return number


def run_numbers(replicates: Any) -> Sequence[int]:
    """Return the numbers of the runs.

    Args:
        replicates: how many runs, or their numbers.

    Raises:
        UsageError: it is neither, or a number stands twice.
    """
    if _whole(replicates) is not None:
        return range(run_count(replicates))
    if isinstance(replicates, str | bytes | bool) or not isinstance(replicates, Iterable):
        raise UsageError(f"replicates: expected {ALLOWED}, got {replicates!r:.80}")
    chosen = [run_number(each, "replicates") for each in replicates]
    if not chosen:
        raise UsageError(f"replicates: must be at least 1, expected {ALLOWED}, got no run")
    twice = next((number for number, times in Counter(chosen).items() if times > 1), None)
    if twice is not None:
        raise UsageError(f"replicates: run {twice} is named twice, expected {ALLOWED}")
    return chosen


def _whole(value: Any) -> int | None:
    """The whole number that a value is (NumPy's included), or None; a bool is none."""
    if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b":
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None
