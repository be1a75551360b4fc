"""Monte Carlo runs: their numbers, from what a caller gives, and the progress of them and of other work.

run_numbers(3) -> [0, 1, 2]        run_numbers([4, 7]) -> [4, 7]
throttled(progress, first, began, overhead)      reports the progress of a simulation, at most ten times a second
for file in tracked(files, "files read"): ...    that of other work; `watching(report)` says who is told
"""

from __future__ import annotations

import contextlib
import contextvars
import operator
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

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


Item = TypeVar("Item")

OnTime: TypeAlias = Callable[[float], None]
"""Called now and then with the simulated time (s)."""


@dataclass(frozen=True)
class Progress:
    """The progress of `run`: simulated `time` of `duration` seconds in one of the runs, after `wall` seconds.

    `replicate` counts the runs of this call from 0. `overhead`: the seconds of `wall` that do not grow with the
    simulated time: those before the first run, and those in which kernels were compiled, which happens once.
    """

    replicate: int
    replicates: int
    time: float
    duration: float
    wall: float
    overhead: float = 0.0

    @property
    def simulated(self) -> float:
        """Simulated seconds of all runs until now."""
        return self.replicate * self.duration + self.time

    @property
    def left(self) -> float | None:
        """Estimated seconds until the end, None while there is no estimate."""
        if not self.simulated:
            return None
        remaining = self.replicates * self.duration - self.simulated
        return (self.wall - self.overhead) * remaining / self.simulated


def throttled(
    progress: Callable[[Progress], None] | None, first: Progress, began: float, overhead: Callable[[], float]
) -> OnTime | None:
    """A function of the simulated time that calls `progress` at most ten times a second, and at the end.

    Args:
        progress: Gets the progress; None reports nothing.
        first: The progress at the start of the run.
        began: When the work began, as `time.monotonic` gives it.
        overhead: Returns the overhead (s) until now, see `Progress`.
    """
    if progress is None:
        return None
    reported = 0.0

    def on_time(now: float) -> None:
        nonlocal reported
        wall = time.monotonic()
        if wall - reported >= 0.1 or now >= first.duration:
            reported = wall
            progress(replace(first, time=min(now, first.duration), wall=wall - began, overhead=overhead()))

    return on_time


class WorkProgress(NamedTuple):
    """The progress of work other than a simulation: `done` of `total` items of a kind (`what`) after `wall` seconds."""

    what: str
    done: int
    total: int
    wall: float


_WATCHER: Final[contextvars.ContextVar[Callable[[WorkProgress], None] | None]] = contextvars.ContextVar(
    "watcher", default=None
)


@contextlib.contextmanager
def watching(report: Callable[[WorkProgress], None]) -> Iterator[None]:
    """Within this context, `report` is called with the progress of tracked work."""
    token = _WATCHER.set(report)
    try:
        yield
    finally:
        _WATCHER.reset(token)


def tracked(items: Sequence[Item], what: str) -> Iterator[Item]:
    """The items, one after the other. Whoever is watching is told how many of them are done, and at the end.

    Args:
        items: what is worked on.
        what: the items and what is done to them, such as "files read".
    """
    report = _WATCHER.get()
    if report is None:
        yield from items
        return
    began = time.monotonic()
    reported = began
    for number, item in enumerate(items):
        yield item
        now = time.monotonic()
        if now - reported >= 0.1 or number + 1 == len(items):
            reported = now
            report(WorkProgress(what, number + 1, len(items), now - began))
