"""What a scenario with recorded readings must not change: trajectory, detection and clocks are those of the recording.

Nor may it judge a law on the readings that it was fitted to.

recorded_issues(sensor, setup) -> Iterator[Issue]
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import Issue
from wsnsim.base.files import content_digest
from wsnsim.base.optional_ports import ConstantGaussian
from wsnsim.base.ports import MotionModel
from wsnsim.base.sensing import is_perfect
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.recorded_track import RecordedTrack

SAME_TIME: Final = 1e-9
"""s: difference of two origins of time that is rounding."""
MOST_STEPS: Final = 20
"""Steps of a trajectory that are compared."""


def recorded_issues(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue for each component that samples what was recorded, for other origins of time, and in-sample laws.

    What is judged must not be in what was fitted: a law whose `fitted_on` has the digest of the readings is refused.
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
    if not is_perfect(setup.detection):
        message = "recorded readings have the detection errors of the world that they come from: use kind: perfect"
        yield Issue(("detection", "kind"), message)


def _is_in_sample(sensor: Any) -> bool:
    """Whether the law was fitted to the file of readings; its content counts, not its name or compression."""
    fitted_on = getattr(sensor.law, "fitted_on", ())
    return bool(fitted_on) and content_digest(sensor.path) in fitted_on


def _cannot_count(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue if a filter cannot be told of how many readings one is the mean."""
    key = ("sensor", "several")
    if isinstance(setup, NetworkSetup):
        yield Issue(key, "in a network, nodes send one reading a step and not how many it stands for: use mean or last")
    if not (isinstance(sensor.law, ConstantGaussian) and sensor.law.constant_gaussian):
        yield Issue(key, "all needs a law whose noise is Gaussian with a constant variance: use mean or last")
    if getattr(getattr(setup.filter_sensor, "law", None), "inflate", False):
        message = "what widens the noise is common to all readings of a node: use several: mean or last"
        yield Issue(("tracker", "assumes", "inflate"), message)


def _is_given(motion: MotionModel, setup: TrackingSetup) -> bool:
    """Whether a trajectory is the same with all random numbers."""
    steps = min(setup.steps, MOST_STEPS)
    one, other = (motion.truth(steps, setup.dt, np.random.default_rng(seed)) for seed in (1, 2))
    return bool(np.array_equal(one, other))


def _other_origin(sensor: Any, motion: RecordedTrack) -> Iterator[Issue]:
    """Yield an issue if the time 0 of readings and trajectory follows from their files, and differs."""
    if None not in (sensor.time_origin, motion.time_origin):
        return
    apart = motion.origin - sensor.origin
    if abs(apart) > SAME_TIME:
        message = (
            f"the trajectory begins at {motion.origin:.9g} s, the readings at {sensor.origin:.9g} s: give "
            "time_origin for both"
        )
        yield Issue(("sensor", "time_origin"), message)
