"""Rows, and CPU seconds of acts that are taken in turn, so that a drifting machine serves all alike."""

from __future__ import annotations

import math
import re
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import simpy


def row(
    name: str,
    value: float,
    unit: str,
    bound: float | None = None,
    at_least: float | None = None,
    note: str = "",
) -> dict[str, Any]:
    """One figure. `within` says whether it keeps to its bounds, None where there is none or the figure is missing."""
    within = None
    if not math.isnan(value) and (bound is not None or at_least is not None):
        within = (bound is None or value <= bound) and (at_least is None or value >= at_least)
    return {
        "name": name,
        "value": value,
        "unit": unit,
        "bound": bound,
        "at_least": at_least,
        "within": within,
        "note": note,
    }


def peak_megabytes() -> float:
    """The most memory this program has held; NaN if unknown. `ru_maxrss` would be its parent's, if that is more."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text()) if status.exists() else None
    return int(found[1]) * 1024 / 1e6 if found else math.nan


def paired_seconds(
    acts: list[Callable[[], Any]], repeats: int, prepare: Callable[[], Any] | None = None
) -> list[list[float]]:
    """CPU seconds of each of several acts, `repeats` times in turn; `prepare` is called before each turn, untimed."""
    seconds: list[list[float]] = [[] for _ in acts]
    for _ in range(repeats):
        if prepare:
            prepare()
        for act, mine in zip(acts, seconds, strict=True):
            began = time.process_time()
            act()
            mine.append(time.process_time() - began)
    return seconds


def paired_medians(acts: list[Callable[[], Any]], repeats: int) -> list[float]:
    """Median CPU seconds of each of several acts, taken in turn."""
    return [statistics.median(mine) for mine in paired_seconds(acts, repeats)]


def median_ratio(above: list[float], below: list[float]) -> float:
    """The median over the turns of one act's seconds in another's of the same turn."""
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


def median_cpu(act: Callable[[], Any], repeats: int) -> float:
    """Median CPU seconds of an act."""
    return paired_medians([act], repeats)[0]


def bare_timeouts(count: int) -> None:
    """SimPy alone: 100 processes that do nothing but wait."""
    env = simpy.Environment()

    def waiter() -> Any:
        while True:
            yield env.timeout(1.0)

    for _ in range(100):
        env.process(waiter())
    env.run(until=count / 100)


def seconds_of_a_timeout(count: int = 60_000) -> float:
    """CPU seconds of a bare SimPy timeout, with 100 processes."""
    began = time.process_time()
    bare_timeouts(count)
    return (time.process_time() - began) / count
