"""Every tracker of the catalogue honours the periods of angles, or is refused with a reason.

The scripted target passes west of its nodes, where bearings jump from π to -π. Turned by a quarter of a turn, the same
geometry has bearings around -π/2, which do not jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pytest

from tests.helpers.tracker_kinds import trackers_of_one_target
from wsnsim import scenario
from wsnsim.base.arrays import Estimate
from wsnsim.base.errors import ScenarioError
from wsnsim.models.bearing import TURN, Bearing, RangeBearing
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ungm import Ungm
from wsnsim.scenario.registry import load_class
from wsnsim.testing.table import FIRST, SCRIPT, SECOND, Table, track

KINDS = {row.kind: load_class(row) for row in trackers_of_one_target()}
WITH_ANGLES = [kind for kind, part in KINDS.items() if part.angles and kind != "grid"]
WITH_COMPONENTS = [kind for kind in WITH_ANGLES if KINDS[kind].vector_readings]
EXACT = {"ekf": 1e-9, "rkf": 1e-9, "imsf": 1e-9, "imm": 1e-9, "ukf": 0.01, "ckf": 0.01}
"""How far (m) the estimates of filters without random numbers may be from those of the turned geometry.

The sigma points of a turned covariance are not the turned sigma points, since they depend on the order of the axes.
"""
QUARTER = np.kron(np.array([[0.0, -1.0], [1.0, 0.0]]), np.eye(2))
"""Turns a state (px, vx, py, vy) by a quarter of a turn."""


@dataclass
class Passing(Table):
    """A target that passes west of nodes that stand in two columns, from south-west to north-west of them."""

    turned: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        steps = np.arange(len(self.truth)) * 0.04
        self.truth = np.column_stack([0.0 * steps, 0.0 * steps, 20.0 * (steps - 0.2), 20.0 + 0.0 * steps])
        ids = sorted({*FIRST, *SECOND})
        self.places = {node: np.array([20.0 + 5.0 * (i % 2), 1.5 * (i - 4)]) for i, node in enumerate(ids)}
        if self.turned:
            self.truth = self.truth @ QUARTER.T
            self.places = {node: np.array([-place[1], place[0]]) for node, place in self.places.items()}

    @property
    def prior(self) -> Estimate:
        shift = np.array([0.5, -0.3, 0.4, 0.2])
        return Estimate(self.truth[0] + (QUARTER @ shift if self.turned else shift), np.eye(4))


def made(kind: str) -> Any:
    """A tracker with few particles, which it moves a few times only: rounding errors grow with each move."""
    part = KINDS[kind]
    fewer = {"particles": 300, "cells": 300, "iterations": 1 if kind == "ekf" else 3}
    return part(**{field.name: fewer[field.name] for field in fields(part) if field.name in fewer})


def means_of(kind: str, table: Table) -> np.ndarray:
    """The means of every estimate and forecast of a scripted track."""
    return np.array([estimate.mean for estimate in track(made(kind), table)])


def sensor_of(components: int) -> Any:
    return Bearing(sd=0.02) if components == 1 else RangeBearing(range_sd=0.5, bearing_sd=0.02)


def whole_turns(sensor: Any, node: int, reading: Any) -> Any:
    """The same reading, its angles given one turn more or two turns less."""
    turns = TURN * (1 if node % 2 else -2)
    if not isinstance(reading, tuple):
        return reading + turns
    return tuple(value + (turns if period else 0.0) for value, period in zip(reading, sensor.periods, strict=True))


class Deaf(Bearing):
    """Bearings whose period nobody is told of."""

    periods = (0.0,)


def mean_error(means: np.ndarray, table: Table) -> float:
    """The mean error (m) of the estimates of a scripted track, its forecasts left out."""
    steps, last = [0], 0
    for passed, _ in SCRIPT:
        last += passed
        steps += [last, -1]
    steps = [*steps, last, last + 1, last + 2, last + 3][: len(means)]
    issued = [row for row, step in enumerate(steps) if step >= 0]
    apart = means[issued] - table.truth[[steps[row] for row in issued]]
    return float(np.mean(np.hypot(apart[:, 0], apart[:, 2])))


CASES = [*((kind, 1) for kind in WITH_ANGLES), *((kind, 2) for kind in WITH_COMPONENTS)]


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "components"), CASES)
def test_whole_turns_of_every_bearing_change_no_estimate(kind: str, components: int) -> None:
    sensor, motion = sensor_of(components), BoundedVelocity()
    table = Passing(motion, sensor, 3)
    shifted = Passing(motion, sensor, 3, alter=lambda node, reading: whole_turns(sensor, node, reading))
    np.testing.assert_allclose(means_of(kind, shifted), means_of(kind, table), atol=1e-6)


def test_whole_turns_change_no_estimate_of_the_grid_filter() -> None:
    sensor, motion = Bearing(sd=0.2), Ungm()
    shifted = Table(motion, sensor, 3, alter=lambda node, reading: whole_turns(sensor, node, reading))
    np.testing.assert_allclose(means_of("grid", shifted), means_of("grid", Table(motion, sensor, 3)), atol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "components"), CASES)
def test_a_target_is_tracked_across_the_cut_as_well_as_in_the_turned_geometry(kind: str, components: int) -> None:
    sensor, motion = sensor_of(components), BoundedVelocity()
    across, turned = (Passing(motion, sensor, 4, turned=way) for way in (False, True))
    bearings = [across.sensor.linearise(across.truth[:, [0, 2]].T, place[None], np.empty((1, 0)))[0][-1]
                for place in across.places.values()]  # fmt: skip
    assert all(np.ptp(angles) > 6.0 for angles in bearings[2:6]), "bearings of the nodes in between cross the cut"
    found, again = means_of(kind, across), means_of(kind, turned) @ QUARTER
    if kind in EXACT:
        np.testing.assert_allclose(found, again, atol=EXACT[kind])
    assert mean_error(found, across) < 4.0 and mean_error(again, across) < 4.0


def test_without_the_period_the_same_target_is_lost_at_the_cut() -> None:
    across = Passing(BoundedVelocity(), Deaf(sd=0.02), 4)
    assert mean_error(means_of("ekf", across), across) > 10.0


REFUSED = [(kind, "bearing") for kind in KINDS if kind not in (*WITH_ANGLES, "grid")] + [
    (kind, "range_bearing") for kind in KINDS if kind not in (*WITH_COMPONENTS, "grid")
]


@pytest.mark.parametrize(("kind", "sensor"), REFUSED)
def test_a_tracker_that_cannot_take_them_is_refused_with_a_reason(kind: str, sensor: str) -> None:
    changes = [f"tracker={{kind: {kind}}}", f"sensor={{kind: {sensor}}}"]
    with pytest.raises(ScenarioError, match=r"needs a sensor that gives 'ranges'|does not take readings of several"):
        scenario.build(scenario.load("jiang_field", changes))


def test_what_is_refused_is_what_needs_distances_or_one_number() -> None:
    distances = {"trilateration", "gmtt", "tsstp", "cluster", "ris"}
    assert {kind for kind, sensor in REFUSED if sensor == "bearing"} == distances
    assert {kind for kind, sensor in REFUSED if sensor == "range_bearing"} == distances | {"rkf", "imsf"}
    assert math.isclose(sum(Bearing.periods), TURN)
