"""The check of a scenario with recorded readings, whose trajectory, detection and clocks must be the recorded ones.

A law must not be judged on the readings to which it was fitted.

recorded_issues(sensor, setup) -> Iterator[Issue]
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import SAME_TIME, is_relative
from wsnsim.base.detections import ReportsScans
from wsnsim.base.errors import Issue
from wsnsim.base.files import content_digest
from wsnsim.base.optional_ports import ConstantGaussian
from wsnsim.base.ports import MotionModel
from wsnsim.base.sensing import is_perfect
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.recorded_track import RecordedTrack

MOST_STEPS: Final = 20
"""Number of steps by which two trajectories are compared."""


def recorded_issues(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield issues of components that sample what was recorded, of differing origins of time, and of in-sample laws.

    A law is in-sample if its `fitted_on` contains the digest of the file of readings.
    """
    if not sensor.in_sample and _is_in_sample(sensor):
        message = "these readings are among those that the law was fitted to: use others, or say in_sample: true"
        yield Issue(("sensor", "path"), message)
    for number, motion in enumerate(setup.motions):
        key = ("motion", "kind") if len(setup.motions) == 1 else ("targets", number, "kind")
        if not _is_given(motion, setup):
            message = "readings were recorded of one trajectory, and this one is sampled at random: use recorded_track"
            yield Issue(key, f"{message} (or waypoints)")
        elif isinstance(motion, RecordedTrack):
            yield from _other_origin(sensor, motion)
    if sensor.counted:
        yield from _cannot_count(sensor, setup)
    message = "recorded readings have the detection errors of the world that they come from"
    if isinstance(setup.detection, ReportsScans):
        if any(setup.detection.resolution):
            yield Issue(("detection", "resolution"), f"{message}: give none")
    elif not is_perfect(setup.detection):
        yield Issue(("detection", "kind"), f"{message}: use kind: perfect (or unlabelled)")


def _is_in_sample(sensor: Any) -> bool:
    """Whether the law was fitted to the file of readings; its content counts, not its name or compression."""
    fitted_on = getattr(sensor.law, "fitted_on", ())
    return bool(fitted_on) and content_digest(sensor.path) in fitted_on


def _cannot_count(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield issues where a filter cannot take into account that a reading is the mean of several."""
    key = ("sensor", "several")
    if isinstance(setup, NetworkSetup):
        yield Issue(key, "in a network, nodes send one reading a step and not how many it stands for: use mean or last")
    if is_relative(sensor.law) or not (isinstance(sensor.law, ConstantGaussian) and sensor.law.constant_gaussian):
        message = "all needs a law of independent readings whose noise is Gaussian with a constant variance"
        yield Issue(key, f"{message}: use mean or last")
    if getattr(getattr(setup.filter_sensor, "law", None), "inflate", False):
        message = "the variance that inflate adds is common to all readings of a node: use several: mean or last"
        yield Issue(("tracker", "assumes", "inflate"), message)


def _is_given(motion: MotionModel, setup: TrackingSetup) -> bool:
    """Whether a trajectory does not depend on random numbers: it is the same with two seeds."""
    steps = min(setup.steps, MOST_STEPS)
    one, other = (motion.truth(steps, setup.dt, np.random.default_rng(seed)) for seed in (1, 2))
    return bool(np.array_equal(one, other))


def _other_origin(sensor: Any, motion: RecordedTrack) -> Iterator[Issue]:
    """Yield an issue if readings and trajectory begin at different times, unless both origins are given."""
    if None not in (sensor.time_origin, motion.time_origin):
        return
    apart = motion.origin - sensor.origin
    if abs(apart) > SAME_TIME:
        message = (
            f"the trajectory begins at {motion.origin:.15g} s, the readings at {sensor.origin:.15g} s: give "
            "time_origin for both"
        )
        yield Issue(("sensor", "time_origin"), message)
