"""The check of angles: directions that differ by whole turns are the same, and give the same estimates."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any, Final

import numpy as np

from wsnsim.base.ports import MotionModel, SensorModel, Tracker
from wsnsim.base.vector_readings import Reading, components_of, periods_of
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.testing.table import Table, track
from wsnsim.testing.whole_runs import standalone_setup

TOLERANCE: Final = 1e-4
"""How far an estimate may move, times the largest of its numbers if that is above 1. A whole turn in an innovation
moves it by metres, rounding errors by less, also where a random search enlarges them."""
ESTIMATES: Final = 4
"""Estimates and forecasts that are compared: of the start and of a step. A filter that does not wrap errs at once."""
ADVICE: Final = (
    "Subtract the expected readings of scene.sensor.linearise from near(scene.sensor, rows(scene.sensor, readings), "
    "expected): wsnsim.plugins.near moves angles by whole turns, so that the difference is the shortest (where only "
    "log_likelihood is used, check_sensor says whether it wraps). A tracker that takes no angles says angles = False"
)


def demand_angles(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Check that a tracker compares angles at their shortest difference; one that takes none is left alone.

    The sensor of the check is used if its readings have a period. A tracker that says `angles = True` is also tried
    with the sensors that a scenario may then give to it: bearings, and ranges with bearings.

    Raises:
        AssertionError: An estimate moves when whole turns are added to readings, or when readings are near ±π in place
            of 0 since the axes of the nodes are turned.
    """
    takes = getattr(tracker, "angles", None)
    if any(periods_of(sensor)) and takes is not False:
        _demand_whole_turns(tracker, motion, sensor, seed)
    for each in _shipped(tracker, motion, seed) if takes else ():
        _demand_whole_turns(tracker, motion, each, seed)
        _demand_turned_axes(tracker, motion, each, seed)


def _shipped(tracker: Tracker[Any], motion: MotionModel, seed: int) -> Iterator[SensorModel]:
    """Yield the shipped sensors with angles that a scenario does not refuse for this tracker."""
    for sensor in (Bearing(sd=0.1, heading="own"), RangeBearing(bearing_sd=0.1, heading="own")):
        several = len(components_of(sensor)) > 1
        lacks = [name for name in getattr(tracker, "needs", ()) if not callable(getattr(sensor, name, None))]
        if lacks or (several and not getattr(tracker, "vector_readings", False)):
            continue
        check = getattr(tracker, "check", None)
        if check is None or not list(check(standalone_setup(tracker, motion, sensor, seed))):
            yield sensor


def _demand_whole_turns(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    def turned(node: int, reading: Reading) -> Reading:
        """One turn more at nodes with odd ids, two turns less at the others."""
        turns = 1 if node % 2 else -2
        if not isinstance(reading, tuple):
            return reading + turns * periods_of(sensor)[0]
        return tuple(value + turns * period for value, period in zip(reading, periods_of(sensor), strict=True))

    done = "one turn was added to the angles of some nodes, two were taken from those of others"
    _demand_equal(tracker, Table(motion, sensor, seed), Table(motion, sensor, seed, turned), done)


def _demand_turned_axes(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Turn the axis of each node, which is its trait: the target is straight ahead, and then straight behind."""
    ahead, behind = Table(motion, sensor, seed), Table(motion, sensor, seed)
    for node, place in ahead.places.items():
        across, up = ahead.prior.mean[list(motion.position)][0] - place[0], -place[1]
        if len(motion.position) > 1:
            up += ahead.prior.mean[motion.position[1]]
        ahead.traits[node] = np.array([np.arctan2(up, across)])
        behind.traits[node] = ahead.traits[node] + np.pi
    done = (
        "the axes of all nodes (their trait, heading) were turned by half a turn, so that bearings are near ±π, not 0"
    )
    _demand_equal(tracker, ahead, behind, done)


def _demand_equal(tracker: Tracker[Any], table: Table, other: Table, done: str) -> None:
    pairs = zip(*(islice(track(tracker, each), ESTIMATES) for each in (table, other)), strict=True)
    for number, (one, moved) in enumerate(pairs):
        away, allowed = float(np.abs(moved.mean - one.mean).max()), TOLERANCE * max(1.0, float(np.abs(one.mean).max()))
        assert away <= allowed, (
            f"{type(table.sensor).__name__} ({', '.join(components_of(table.sensor))}): {done}. These are the same "
            f"directions, and no estimate may move by more than {allowed:.1g}; number {number} moved by {away:g}, from "
            f"{_text(one.mean)} to {_text(moved.mean)}. {ADVICE}"
        )


def _text(mean: Any) -> str:
    return np.array2string(mean, precision=4)
