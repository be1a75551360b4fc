"""What a network costs whose radios are off most of the time: X-MAC for 100 s, the same target in ever larger fields.

CPU seconds without drawing and building the network, and MAC frames on the air, strobes and acknowledgements included.
A wake-up that hears nothing is no event: the time must grow with frames, not with nodes or with their wake-ups.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from typing import Any

from tests.bench.timing import row
from wsnsim import experiment, scenario
from wsnsim.base.tables import Memory
from wsnsim.network.world import World

SIZES = (1000, 10_000, 100_000)
DENSITY = 400 / 500.0**2
"""Nodes per m²: that of Li's field."""
INTERVALS = (0.0625, 0.25, 1.0)
"""Wake intervals in s: the number of strobes grows with them."""
GROWTH = 1.5


def mostly_off_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """CPU seconds and frames at three sizes and at three wake intervals."""
    of_sizes = {size: _setup(size, 0.125) for size in SIZES}
    of_intervals = {interval: _setup(SIZES[0], interval) for interval in INTERVALS}
    setups = [*of_sizes.values(), *of_intervals.values()]
    _timed(setups[0])
    found = [[_timed(setup) for setup in setups] for _ in range(min(repeats, 3))]
    seconds = [statistics.median(turn[i][0] for turn in found) for i in range(len(setups))]
    frames = [made for _, made in found[0]]
    for size, taken, sent in zip(SIZES, seconds, frames, strict=False):
        yield row(f"X-MAC, {size:,} nodes, 100 s: CPU without building", taken, "s", note=f"{sent:,} frames")
    each = [1e6 * taken / sent for taken, sent in zip(seconds, frames, strict=True)]
    yield row(f"X-MAC: CPU a frame at {SIZES[-1]:,} nodes over {SIZES[0]:,}", each[2] / each[0], "x", GROWTH)
    for interval, taken, sent in zip(INTERVALS, seconds[3:], frames[3:], strict=True):
        yield row(f"X-MAC, {SIZES[0]:,} nodes, every {interval:g} s: CPU", taken, "s", note=f"{sent:,} frames")
    yield row("X-MAC: CPU a frame, largest of the intervals over the smallest", max(each[3:]) / min(each[3:]), "x", 3.0)


def _setup(nodes: int, interval: float) -> Any:
    side = (nodes / DENSITY) ** 0.5
    changes = (f"deploy.nodes={nodes}", f"deploy.width={side}", f"deploy.height={side}", f"mac.interval={interval}")
    return scenario.build(scenario.load("li_xmac", ("duration=100 s", *changes)))


def _timed(setup: Any) -> tuple[float, int]:
    """CPU seconds of one run after its network was built, and the frames of the run."""
    made: list[tuple[float, World]] = []

    class Watched(World):
        """Says when it is built."""

        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            made.append((time.process_time(), self))

    experiment.World, kept = Watched, experiment.World  # type: ignore[misc]
    try:
        experiment.replicate_of(setup, 0, Memory({}))
    finally:
        experiment.World = kept  # type: ignore[misc]
    built, world = made[0]
    return time.process_time() - built, world._stack.radio.counters.transmissions
