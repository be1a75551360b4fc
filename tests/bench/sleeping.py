"""What a network costs that sleeps: GMTT every 2 s for 200 s, and the same target in a field a hundred times as large.

CPU seconds without drawing and building the network, which are a row of their own; over the same replicates, in turn.
Bare SimPy timeouts at 100 processes are measured in the same turns; the bound is one of timeouts.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from typing import Any

from tests.bench.timing import row, seconds_of_a_timeout
from wsnsim import scenario
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.network.world import World

FEW, MANY = (400, 500.0), (40_000, 5000.0)
"""Nodes, and the side of their field in m: equal densities."""
TIMEOUTS = 220_000
"""Bare timeouts in the time of one replicate."""
GROWTH = 2.0
REPLICATES = range(3)


def sleeping_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """GMTT at 400 nodes, and what a hundred times as many cost that its target never comes near."""
    problems = {size: _problem(*size) for size in (FEW, MANY)}
    for problem in problems.values():
        replicate_of(problem, 0, Memory({}))
    running: dict[Any, list[float]] = {size: [] for size in problems}
    building: dict[Any, list[float]] = {size: [] for size in problems}
    paces = []
    for _ in range(repeats):
        for replicate in REPLICATES:
            paces.append(1.0 / seconds_of_a_timeout())
            for size, problem in problems.items():
                made, whole = _timed(problem, replicate)
                building[size].append(made)
                running[size].append(whole - made)
    few, many = (statistics.median(running[size]) for size in problems)
    pace = statistics.median(paces)
    yield row("GMTT, 400 nodes, 200 s, T_s = 2 s: CPU a replicate", few, "s")
    note = f"{pace / 1e6:.2f} M/s here"
    yield row("GMTT, 400 nodes: a replicate, in bare timeouts at 100 processes", few * pace, "", TIMEOUTS, note=note)
    with_log = statistics.median(_timed(problems[FEW], replicate, log=True)[1] for replicate in REPLICATES)
    yield row("  with every table in memory", with_log, "s")
    yield row("GMTT, 40,000 nodes, the same target: CPU without building", many, "s")
    yield row("  over 400 nodes", many / few, "x", GROWTH)
    yield row("  drawing and building", statistics.median(building[MANY]), "s")


def _problem(nodes: int, side: float) -> Any:
    changes = (f"deploy.nodes={nodes}", f"deploy.width={side}", f"deploy.height={side}")
    return scenario.build(scenario.load("gmtt", changes))


def _timed(problem: Any, replicate: int, log: bool = False) -> tuple[float, float]:
    """CPU seconds until the world is built, and of the whole replicate."""
    made = []

    class Watched(World):
        """Says when it is built."""

        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            made.append(time.process_time())

    import wsnsim.experiment as room

    room.World, kept = Watched, room.World  # type: ignore[misc]
    began = time.process_time()
    try:
        replicate_of(problem, replicate, Memory() if log else Memory({}))
    finally:
        room.World = kept  # type: ignore[misc]
    return made[0] - began, time.process_time() - began
