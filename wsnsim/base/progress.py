"""Progress of simulations, reported at most ten times a second."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

OnTime: TypeAlias = Callable[[float], None]
"""Called now and then with the simulated time (s)."""


@dataclass(frozen=True)
class Progress:
    """The progress of `run`: simulated `time` of `duration` seconds in one of the runs, after `wall` seconds.

    `replicate` counts the runs of this call from 0.
    """

    replicate: int
    replicates: int
    time: float
    duration: float
    wall: float


def throttled(progress: Callable[[Progress], None] | None, first: Progress, began: float) -> OnTime | None:
    """A function of the simulated time that calls `progress` at most ten times a second, and at the end.

    Args:
        progress: Gets the progress; None reports nothing.
        first: The progress at the start of the run.
        began: When the first run began, as `time.monotonic` gives it.
    """
    if progress is None:
        return None
    reported = 0.0

    def on_time(now: float) -> None:
        nonlocal reported
        wall = time.monotonic()
        if wall - reported >= 0.1 or now >= first.duration:
            reported = wall
            progress(replace(first, time=min(now, first.duration), wall=wall - began))

    return on_time
