"""How large and how long a run will be, estimated from its scenario before it starts.

run_size(setup, replicates, batch) -> RunSize
warning(size, free) -> a sentence, or ''        free_memory() -> bytes

Counts follow from densities: of nodes within sensing and communication range, of steps, frames and rows. The prices of
a row and of a particle are those of the shipped scenarios (`docs/performance.md`), rounded: they hold within a factor
of a few, which is enough to tell minutes from days.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import sample_positions
from wsnsim.base.setups import BeaconSetup, NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.offline import offers_batch

HOUR: Final = 3600.0
GIGABYTE: Final = 1e9
# CPU time in s
PER_EVENT: Final = 25e-6
"""Of an event of a network that tracks: what leads to it is included."""
PER_RECEPTION: Final = 5e-6
"""Of an event of a network of beacons."""
PER_STEP: Final = 250e-6
"""Of a step of a target without a network."""
PER_PARTICLE: Final = 100e-9
PER_NODE: Final = 2e-6
CONTENTION: Final = 2.5
"""Factor of a MAC that contends for the channel."""
BATCHED: Final = 0.25
"""Share of the time that runs made many at once take."""
# events a step of a target
OF_MEMBERS: Final = 3.0
"""For each node within sensing range."""
OF_SEARCHERS: Final = 9.0
"""For each neighbour, where awake nodes search for targets."""
# bytes in the file
FILE: Final = 90_000.0
"""Descriptions, attributes and tables without rows."""
FILE_PER_STEP, FILE_PER_NODE, FILE_PER_EVENT, FILE_PER_LINK = 120.0, 60.0, 4.0, 7.0
# bytes in memory
PROGRAM: Final = 200e6
MEMORY_PER_NODE, MEMORY_PER_PAIR = 150.0, 64.0
NUMBER: Final = 8.0
COPIES: Final = 3.0
"""Of states and particles at the same time."""


class RunSize(NamedTuple):
    """The estimated size of the runs of a scenario.

    Attributes:
        steps: steps of all targets in a run.
        nodes: number of nodes.
        replicates: number of runs.
        pairs: ordered pairs of nodes within communication range that a run looks at.
        events: rows of the table `events` in a run.
        seconds: CPU time of all runs in s.
        memory: bytes in memory.
        file: bytes of the result file.
    """

    steps: int
    nodes: int
    replicates: int
    pairs: float
    events: float
    seconds: float
    memory: float
    file: float


def run_size(setup: Setup, replicates: int, batch: bool = True) -> RunSize:
    """The estimated size of the runs of a scenario. `batch`: standalone runs may be made many at once."""
    steps = setup.steps * len(setup.motions) if isinstance(setup, TrackingSetup) else setup.steps + 1
    nodes = _nodes(setup)
    members = _within(setup, setup.sensor.reach) if isinstance(setup, TrackingSetup) else 0.0
    neighbours = _within(setup, setup.link.reach) if isinstance(setup, RadioSetup) else 0.0
    if isinstance(setup, BeaconSetup):
        pairs = nodes * neighbours
        period: Any = getattr(setup.workload, "period", None)
        events = nodes * (setup.duration / period if period else 0.0) * (1.0 + neighbours)
    elif isinstance(setup, NetworkSetup):
        pairs = min(nodes, steps * members) * neighbours
        events = steps * (OF_MEMBERS * members + (OF_SEARCHERS * neighbours if setup.nodes_search else 0.0))
    else:
        pairs = events = 0.0
    held = float(getattr(getattr(setup, "tracker", None), "particles", 0) or 0)  # at each member or in all
    particles = held * max(members if isinstance(setup, NetworkSetup) else 1.0, 1.0)
    many = batch and replicates > 1 and offers_batch(setup)
    seconds = _seconds(setup, events, steps * particles) * (BATCHED if many else 1.0)
    dimensions = len(setup.motions[0].columns) if isinstance(setup, TrackingSetup) else 0
    states = COPIES * NUMBER * (steps + particles) * dimensions
    rows = FILE_PER_STEP * steps + FILE_PER_NODE * nodes
    rows += FILE_PER_EVENT * events if setup.record.get("events") else 0.0
    rows += FILE_PER_LINK * pairs if setup.record.get("links") else 0.0
    rows += NUMBER * steps * particles * dimensions if setup.record.get("particles") else 0.0
    memory = PROGRAM + MEMORY_PER_NODE * nodes + MEMORY_PER_PAIR * pairs + states
    return RunSize(steps, nodes, replicates, pairs, events, seconds * replicates, memory, FILE + rows * replicates)


def warning(size: RunSize, free: float) -> str:
    """A sentence on runs that take more than an hour or more memory than the `free` bytes; '' for others."""
    if size.seconds <= HOUR and size.memory <= free:
        return ""
    lasts = _duration(size.seconds)
    large = size.file >= 0.1 * GIGABYTE
    file = f"{_figure(size.file / GIGABYTE)} GB" if large else f"{_figure(size.file / 1e6)} MB"
    memory = f"{_figure(size.memory / GIGABYTE)} GB of memory"
    if size.memory > free:
        memory += f", of which {_figure(free / GIGABYTE)} GB are free"
    return (
        f"{size.steps:,} steps x {size.nodes:,} nodes x {size.replicates:,} runs take about {lasts} and {memory}, and "
        f"a file of {file}; Ctrl-C ends it"
    )


def free_memory() -> float:
    """Bytes of memory that a process can have without swapping, infinite where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024.0 * next(float(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        pass
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def _seconds(setup: Setup, events: float, particle_steps: float) -> float:
    """CPU time in s of one run."""
    if isinstance(setup, BeaconSetup):
        return PER_RECEPTION * events * _contention(setup) + PER_NODE * _nodes(setup)
    if isinstance(setup, NetworkSetup):
        return PER_EVENT * events * _contention(setup) + PER_PARTICLE * particle_steps + PER_NODE * _nodes(setup)
    assert isinstance(setup, TrackingSetup)
    return PER_STEP * setup.steps * len(setup.motions) + PER_PARTICLE * particle_steps


def _contention(setup: RadioSetup) -> float:
    """The factor of a MAC that contends where links differ; a disk costs no more than an ideal channel."""
    return CONTENTION if getattr(setup.mac, "rate", None) and not setup.link.perfect else 1.0


def _within(setup: Setup, reach: float) -> float:
    """The mean number of nodes within a range in m, if the nodes are spread evenly over the field."""
    field = setup.deploy.field
    return _nodes(setup) * min(math.pi * reach**2 / (field.width * field.height), 1.0)


def _nodes(setup: Setup) -> int:
    """The number of nodes: as the deployment says it, else counted in the first run; 1 if that fails."""
    count = getattr(setup.deploy, "nodes", None)
    if count is not None:
        return int(count)
    reach = setup.sensor.reach if isinstance(setup, TrackingSetup) else math.inf
    try:
        return len(sample_positions(setup, reach, 0))
    except RunError:
        return 1


def _duration(seconds: float) -> str:
    """A duration in words."""
    for unit, length in (("years", 365.25 * 24 * HOUR), ("days", 24 * HOUR), ("hours", HOUR), ("minutes", 60.0)):
        if seconds >= 2.0 * length:
            return f"{_figure(seconds / length)} {unit}"
    return f"{_figure(seconds)} s"


def _figure(value: float) -> str:
    """A number with two digits."""
    return f"{float(f'{value:.2g}'):,g}"
