"""The checks of a tracker's whole runs and of its angles.

Whole runs must equal the runs that its requests make, alone and in a block. Directions that differ by whole turns are
the same, and give the same estimates.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, Reading, components_of, periods_of, planar
from wsnsim.base.part import part
from wsnsim.base.ports import MotionModel, SensorModel, Tracker
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.acquire import AroundTruth
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.deploy import Anchors
from wsnsim.models.hardware import PerfectDetection
from wsnsim.offline import offers_batch
from wsnsim.offline.batch import run_batch
from wsnsim.testing.table import DT, FARTHEST, Table, track

STEPS: Final = 6
RUNS: Final = 3
TOLERANCE: Final = 1e-9
"""Relative to the largest value of a column."""
TABLES: Final = dict.fromkeys(("runs", "tracks", "estimates", "covariances"), True)


def demand_whole_runs(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Check the whole runs of a tracker that offers them, with a sensor whose readings have one component.

    Raises:
        AssertionError: A column differs from that of composed runs, or a run alone from the same run in a block.
    """
    setup = standalone_setup(tracker, motion, sensor, seed)
    if not offers_batch(setup):
        return
    block, composed = Memory(TABLES), Memory(TABLES)
    if run_batch(setup, range(RUNS), block) is None:
        return
    alone = Memory(TABLES)
    for replicate in range(RUNS):
        replicate_of(setup, replicate, composed)
        run_batch(setup, [replicate], alone)
    _demand_equal(composed, block, TOLERANCE, "whole_runs differs from the runs that start and step make")
    _demand_equal(alone, block, 0.0, "a run alone differs from the same run in a block")


@part
class _AnchorsInSpace(Anchors):
    """Anchors with heights, for sensor models that need them."""

    @property
    def heights(self) -> Floats:
        """(N,) from 0 to 3 m."""
        return np.linspace(0.0, 3.0, len(self.places))


def standalone_setup(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> TrackingSetup:
    """Eight sensors around the start of a target."""
    rng = np.random.default_rng(seed)
    start = motion.truth(1, DT, rng)[0]
    spread = 0.4 * min(sensor.reach, FARTHEST)
    places = planar(start[list(motion.position)]) + rng.uniform(-spread, spread, (8, 2))
    return TrackingSetup(
        name="check",
        seed=seed,
        steps=STEPS,
        dt=DT,
        deploy=_AnchorsInSpace(places=tuple((float(x), float(y)) for x, y in places)),
        prior=AroundTruth(sd=(2.0,) * start.size),
        motions=(motion,),
        sensor=sensor,
        filter_motions=(motion,),
        filter_sensor=sensor,
        tracker=tracker,
        detection=PerfectDetection(),
    )


def _demand_equal(one: Memory, other: Memory, tolerance: float, fault: str) -> None:
    exempt = {"cpu_seconds", *(("fingerprint", "event_fingerprint") if tolerance else ())}
    for table in TABLES:
        left, right = one.table(table), other.table(table)
        assert left.keys() == right.keys(), f"{fault}: the columns of {table}"
        for name in sorted(left.keys() - exempt):
            assert left[name].shape == right[name].shape, f"{fault}: the number of rows of {table}"
            scale = tolerance * max(1.0, float(np.nanmax(np.abs(left[name]), initial=0.0)))
            same = np.allclose(left[name], right[name], rtol=0.0, atol=scale, equal_nan=True)
            assert same, f"{fault}: column {name} of {table}"


ANGLE_TOLERANCE: Final = 1e-4
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
    _demand_same_angles(tracker, Table(motion, sensor, seed), Table(motion, sensor, seed, turned), done)


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
    _demand_same_angles(tracker, ahead, behind, done)


def _demand_same_angles(tracker: Tracker[Any], table: Table, other: Table, done: str) -> None:
    pairs = zip(*(islice(track(tracker, each), ESTIMATES) for each in (table, other)), strict=True)
    for number, (one, moved) in enumerate(pairs):
        away, allowed = (
            float(np.abs(moved.mean - one.mean).max()),
            ANGLE_TOLERANCE * max(1.0, float(np.abs(one.mean).max())),
        )
        assert away <= allowed, (
            f"{type(table.sensor).__name__} ({', '.join(components_of(table.sensor))}): {done}. These are the same "
            f"directions, and no estimate may move by more than {allowed:.1g}; number {number} moved by {away:g}, from "
            f"{_text(one.mean)} to {_text(moved.mean)}. {ADVICE}"
        )


def _text(mean: Any) -> str:
    return np.array2string(mean, precision=4)
