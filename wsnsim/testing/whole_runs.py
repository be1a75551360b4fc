"""The check of a tracker's whole runs: they must equal the runs that its requests make, alone and in a block."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.part import part
from wsnsim.base.ports import MotionModel, SensorModel, Tracker
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.acquire import AroundTruth
from wsnsim.models.deploy import Anchors
from wsnsim.models.hardware import PerfectDetection
from wsnsim.offline.batch import offers_batch, run_batch
from wsnsim.testing.table import DT, FARTHEST

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
