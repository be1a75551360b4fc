"""What a scenario says that changes nothing in its runs: a note each, for `setup_notes`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import sample_positions
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.rng import Streams, derive
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.network.faults import ROUNDING, places_hit


def _if(other: str, *values: Any) -> Callable[[Any, Setup], bool]:
    """Whether another parameter has one of these values, or any but 0; it does where a plug-in lacks it."""

    def counts(part: Any, _: Setup) -> bool:
        value = getattr(part, other, values[0] if values else True)
        return value in values if values else bool(value)

    return counts


def _with_targets(_: Any, setup: Setup) -> bool:
    return isinstance(setup, TrackingSetup)


def _with_slots(part: Any, setup: Setup) -> bool:
    """Whether a MAC has slots inside clusters, or none of TDMA's parameters for them."""
    return _with_targets(part, setup) or part.mechanism != "tdma"


SLOTS: Final = ("acks", "guard", "slot", "schedule_bits", "contention", "idle_slots")
"""Parameters of TDMA that count only inside clusters."""
CONDITIONS: Final = (
    ("detection", "stuck_at", _if("stuck"), "while no sensor is stuck: give detection.stuck"),
    ("motion", "room", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("motion", "slack", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("sensor", "dof", _if("noise", "student_t"), "with this noise: give sensor.noise: student_t"),
    ("sensor", "decorrelation", _if("shadowing"), "without shadowing: give sensor.shadowing"),
    ("link", "capture_margin", _if("interference", "sinr"), "without link.interference: sinr"),
    ("deploy", "position_error", _with_targets, "with a workload without targets"),
    ("energy", "sensing", _with_targets, "with a workload without targets"),
    *(("mac", key, _with_slots, "with a workload without targets") for key in SLOTS),
)
"""(role, parameter, whether it has an effect, what it needs) of parameters that depend on others."""

READINGS: Final = ("stuck", "bias")
LASTING: Final = (*READINGS, "blackout", "link_loss", "clock_step")
"""Mechanisms that do nothing but last, and those of them that concern readings alone."""
OUTAGES: Final = ("crash", "restart")
"""Mechanisms that only stop readings where there is no network."""


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


def faults_between_instants(setup: Setup) -> Iterator[str]:
    """Faults whose times forbid an effect: they pass at once, or before or after sensors measure."""
    for number, fault in enumerate(setup.faults):
        standalone = not isinstance(setup, RadioSetup)
        if fault.mechanism not in LASTING + OUTAGES * standalone or _ends_a_crash(fault, setup):
            continue
        searches = isinstance(setup, NetworkSetup) and setup.polls > 1
        sensors_alone = (fault.mechanism in READINGS and not searches) or fault.mechanism in OUTAGES
        end = setup.duration if fault.duration is None else min(fault.at + fault.duration, setup.duration)
        name = f"faults[{number}] ({fault.mechanism}): no effect"
        if fault.duration == 0.0:
            yield f"{name} with a duration of 0 s"
        elif sensors_alone and _instant_from(fault.at, setup) >= min(_instant_from(end, setup), setup.steps + 1):
            last = f"every {setup.dt:g} s, up to {setup.steps * setup.dt:g} s"
            yield f"{name} from {fault.at:g} s to {end:g} s: sensors measure {last}"


def _instant_from(time: float, setup: Setup) -> int:
    """The number of the first instant that is not before a time."""
    return math.ceil(time / setup.dt - ROUNDING)


def _ends_a_crash(fault: FaultEvent, setup: Setup) -> bool:
    """Whether a restart may bring back nodes that are down by a crash."""
    return fault.mechanism == "restart" and any(
        other.mechanism == "crash"
        and other.at <= fault.at <= other.at + (math.inf if other.duration is None else other.duration)
        for other in setup.faults
    )


def covering_range(setup: Setup) -> float:
    """The range that must cover the field: of the sensors, or of the links of a network without targets."""
    if isinstance(setup, TrackingSetup):
        return setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return setup.link.reach
