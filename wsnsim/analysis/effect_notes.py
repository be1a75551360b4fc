"""What a scenario says that changes nothing in its runs: a note each, for `setup_notes`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import sample_positions
from wsnsim.base.rng import Streams, derive
from wsnsim.base.setups import RadioSetup, Setup, TrackingSetup
from wsnsim.network.faults.schedule import places_hit


def keys_without_effect(setup: Setup) -> Iterator[str]:
    """Keys of the scenario about what this kind of run does not have."""
    if setup.unused:
        why = "network: none" if isinstance(setup, TrackingSetup) else "a workload without targets"
        yield f"{', '.join(setup.unused)}: no effect with {why}"


def faults_that_hit_nobody(setup: Setup) -> Iterator[str]:
    """Faults aimed at a share of so few nodes, at a region or at numbers where there is no node in the first run."""
    aimed = [(number, fault) for number, fault in enumerate(setup.faults) if fault.head is None]
    if not aimed:
        return
    with contextlib.suppress(RunError):  # `notes.of_setup` says so
        positions = sample_positions(setup, covering_range(setup), 0)
        grid, key = CellGrid(positions), Streams(setup.seed, 0).key("faults")
        for number, fault in aimed:
            if not places_hit(fault, derive(key, number), grid):
                yield f"run 0: faults[{number}] ({fault.mechanism}) hits none of the {len(positions)} nodes"


def covering_range(setup: Setup) -> float:
    """The range that must cover the field: of the sensors, or of the links of a network without targets."""
    if isinstance(setup, TrackingSetup):
        return setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return setup.link.reach
