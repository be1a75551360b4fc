"""What a scenario says that changes nothing in its runs: a note each, for `setup_notes`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, Final

from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import sample_positions
from wsnsim.base.rng import Streams, derive
from wsnsim.base.setups import RadioSetup, Setup, TrackingSetup
from wsnsim.network.faults.schedule import places_hit


def _if(other: str, *values: Any) -> Callable[[Any, Setup], bool]:
    """Whether another parameter has one of these values, or any but 0; it does where a plug-in lacks it."""

    def counts(part: Any, _: Setup) -> bool:
        value = getattr(part, other, values[0] if values else True)
        return value in values if values else bool(value)

    return counts


def _with_targets(_: Any, setup: Setup) -> bool:
    return isinstance(setup, TrackingSetup)


CONDITIONS: Final = (
    ("detection", "stuck_at", _if("stuck"), "while no sensor is stuck: give detection.stuck"),
    ("motion", "room", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("motion", "slack", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("sensor", "dof", _if("noise", "student_t"), "with this noise: give sensor.noise: student_t"),
    ("sensor", "decorrelation", _if("shadowing"), "without shadowing: give sensor.shadowing"),
    ("link", "capture_margin", _if("interference", "sinr"), "without link.interference: sinr"),
    ("deploy", "position_error", _with_targets, "with a workload without targets"),
    ("energy", "sensing", _with_targets, "with a workload without targets"),
)
"""(role, parameter, whether it has an effect, what it needs) of parameters that depend on others."""


def keys_without_effect(setup: Setup) -> Iterator[str]:
    """Keys of the scenario about what this kind of run does not have."""
    if setup.unused:
        why = "network: none" if isinstance(setup, TrackingSetup) else "a workload without targets"
        yield f"{', '.join(setup.unused)}: no effect with {why}"


def parameters_without_effect(setup: Setup) -> Iterator[str]:
    """Parameters with another value than by default that count only with another one, or in another kind of run."""
    for role, key, counts, need in CONDITIONS:
        parts = (
            setup.motions if role == "motion" and isinstance(setup, TrackingSetup) else (getattr(setup, role, None),)
        )
        for part in parts:
            given = getattr(part, key, None) != getattr(type(part), key, None)
            if given and not counts(part, setup):
                yield f"{role}.{key}: no effect {need}"


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
