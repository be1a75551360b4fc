"""Filters with frequent mistakes: `check_tracker` finds angles that are not wrapped, and steps that were missed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.test_testing import Honest
from wsnsim import Compute, Estimate, Gather, GatherReadings, Parcel, Send, part
from wsnsim.cli.starters.tracker import PACKET_BITS, PluginTracker
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.plugins import derive_all, normals, rows
from wsnsim.testing import check_tracker
from wsnsim.testing import privacy as missed_steps_check
from wsnsim.testing.privacy import demand_missed_steps
from wsnsim.testing.whole_runs import demand_angles


def wrapped(angles: Any) -> Any:
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


@part
class Kalman(PluginTracker):
    """An extended Kalman filter that subtracts angles with the formula of a textbook."""

    def difference(self, sensor: Any, measured: Any, expected: Any) -> Any:
        """Return the innovation (S,)."""
        periods = np.tile(getattr(sensor, "periods", (0.0,)), len(measured) // len(getattr(sensor, "periods", (0.0,))))
        return np.where(periods > 0.0, wrapped(measured - expected), measured - expected)

    def updated(self, predicted, scene, readings, members):
        axes, cov = list(scene.motion.position), predicted.cov
        expected, gradients, variances = scene.sensor.linearise(
            predicted.mean[axes][:, None], scene.positions[members], scene.traits[members]
        )
        slopes = np.zeros((len(expected), predicted.mean.size))
        slopes[:, axes] = gradients[:, :, 0]
        gain = np.linalg.solve(slopes @ cov @ slopes.T + np.diag(variances[:, 0]), slopes @ cov).T
        apart = self.difference(scene.sensor, rows(scene.sensor, readings), expected[:, 0])
        left = np.eye(predicted.mean.size) - gain @ slopes
        cov = left @ cov @ left.T + gain * variances[:, 0] @ gain.T
        return Estimate(predicted.mean + gain @ apart, 0.5 * (cov + cov.T))


@part
class NeverWraps(Kalman):
    """The innovation is the difference of two angles."""

    def difference(self, sensor, measured, expected):
        return measured - expected


@part
class WrapsReadings(Kalman):
    """Readings are moved into ±π, and then subtracted as numbers."""

    def difference(self, sensor, measured, expected):
        return wrapped(measured) - expected


@part
class SaysNothingOfAngles(NeverWraps):
    """It neither wraps nor says whether it takes angles."""

    angles = None  # as if it were not there


@part
class TakesNoAngles(NeverWraps):
    """It does not wrap, and says so: a scenario with bearings refuses it."""

    angles = False


@part
class OneStep(Kalman):
    """It always predicts one step."""

    def step(self, belief, scene):
        return (yield from super().step(belief, replace(scene, steps=1)))


@part
class OneStepOfNoise(Kalman):
    """The mean is predicted over all steps, the covariance over one."""

    def predicted(self, belief, scene, steps, time):
        return Estimate(
            super().predicted(belief, scene, steps, time).mean, super().predicted(belief, scene, 1, time).cov
        )


@part
class OneStepWithReadings(Kalman):
    """It predicts one step when readings arrive, and keeps its belief when none do."""

    def step(self, belief, scene):
        heard = yield GatherReadings(PACKET_BITS)
        yield Compute(100.0)
        if not heard.ids:
            return belief
        members = [scene.ids.index(node) for node in heard.ids]
        return self.updated(self.predicted(belief, scene, 1, scene.previous), scene, heard.values, members)


@part
class OwnTransition(Kalman):
    """Its transition matrix is its own, made for steps of 0.04 s."""

    def predicted(self, belief, scene, steps, time):
        move = np.kron(np.eye(2), np.array([[1.0, 0.04], [0.0, 1.0]]))
        return Estimate(move @ belief.mean, move @ belief.cov @ move.T + 0.01 * np.eye(4))


@part
class OneStepOfParticles(Honest):
    """Particles in the head, which are moved once at each step."""

    def start(self, prior, scene):
        keys = derive_all(scene.key, np.arange(200))
        noise = np.array([normals(keys, draw) for draw in range(prior.mean.size)])
        return prior.mean[:, None] + np.linalg.cholesky(prior.cov) @ noise
        yield  # a flow without requests

    def steps(self, scene):
        return 1

    def step(self, belief, scene):
        answer = yield Gather(
            lambda member: Parcel(member.reading, 1, PACKET_BITS, "reading") if member.reading else None
        )
        yield Compute(100.0)
        for step in range(self.steps(scene)):
            keys = derive_all(scene.key, 1000 * step + np.arange(200))
            belief = scene.motion.propagate(belief, scene.dt, keys, scene.since + step * scene.dt)
        members = [scene.ids.index(node) for node in answer]
        readings = np.array([reading for reading, _ in answer.values()])
        points = belief[list(scene.motion.position)]
        logs = scene.sensor.log_likelihood(points, readings, scene.positions[members], scene.traits[members])
        chances = np.cumsum(np.exp(logs - logs.max()))
        return belief[:, np.searchsorted(chances, (np.arange(200) + 0.5) / 200 * chances[-1])]

    def estimate(self, belief):
        return Estimate(belief.mean(axis=1), np.cov(belief))

    def forecast(self, belief, scene, ahead):
        return self.estimate(belief)

    def hand_over(self, belief, scene, successor):
        arrived = yield Send(successor, Parcel(belief, 80, PACKET_BITS, "particles"))
        return belief if arrived.all() else None


class Particles(OneStepOfParticles):
    """The same, moved as often as steps have passed."""

    def steps(self, scene):
        return scene.steps


TURNS = r"demand 'angles': Bearing \(bearing\): one turn was added to .* may move by more than .* moved by .*" + (
    r" near\(scene.sensor, rows\(scene.sensor, readings\), expected\): wsnsim.plugins.near .* angles = False"
)
AXES = r"demand 'angles': Bearing \(bearing\): the axes of all nodes .* near ±π, not 0\. .* wsnsim.plugins.near"


@pytest.mark.thorough(fast=["WrapsReadings-NoneType-str"])
@pytest.mark.parametrize(
    ("tracker", "sensor", "message"),
    [
        (NeverWraps(), None, TURNS),
        (NeverWraps(), Bearing(), TURNS),
        (NeverWraps(), RangeBearing(), TURNS.replace(r"Bearing \(bearing\)", r"RangeBearing \(range, bearing\)")),
        (SaysNothingOfAngles(), Bearing(), TURNS),
        (WrapsReadings(), Bearing(), AXES),
        (WrapsReadings(), None, AXES),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_filter_that_does_not_wrap_angles_is_found(tracker: Any, sensor: Any, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_tracker(tracker, sensor=sensor)


@pytest.mark.thorough(fast=["PluginTracker-NoneType"])
@pytest.mark.parametrize(
    ("tracker", "sensor"),
    [
        (Kalman(), None),
        (Kalman(), Bearing(heading="own")),
        (PluginTracker(), None),
        (PluginTracker(), Bearing()),
        (PluginTracker(), RangeBearing()),
        (SaysNothingOfAngles(), None),
        (TakesNoAngles(), Bearing()),
        (Particles(), None),
        (Particles(), Bearing()),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_filter_that_wraps_or_takes_no_angles_passes(tracker: Any, sensor: Any) -> None:
    check_tracker(tracker, sensor=sensor)


def test_a_filter_that_needs_more_than_bearings_or_refuses_them_is_not_tried_with_them() -> None:
    @part
    class NeedsRanges(NeverWraps):
        needs = ("ranges",)

    @part
    class Refuses(NeverWraps):
        def check(self, setup):
            if isinstance(setup.sensor, Bearing | RangeBearing):
                yield "no bearings"

    for tracker in (NeedsRanges(), Refuses()):
        demand_angles(tracker, ConstantVelocity(), AcousticEnergy(), 1)


MISSED = (
    r"demand 'missed steps': the head missed 4 steps .*{}: scene.steps was 5. The {} was expected to be predicted "
    + (r"over 5 steps.*; it is that of scene.steps = 1, bit for bit: .*scene.motion.advance\(mean, scene.dt")
)
WITHOUT, WITH = "without a reading", "with the readings of all members"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("tracker", "message"),
    [
        (OneStep(), MISSED.format(WITHOUT, "mean")),
        (OneStepOfNoise(), MISSED.format(WITHOUT, "covariance")),
        (OneStepWithReadings(), MISSED.format(WITH, "mean")),
        (OwnTransition(), MISSED.format(WITHOUT, "mean")),
        (OneStepOfParticles(), MISSED.format(WITHOUT, "mean")),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_filter_that_always_predicts_one_step_is_found(tracker: Any, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_tracker(tracker)


@pytest.mark.thorough
def test_a_filter_that_predicts_nothing_passes() -> None:
    check_tracker(Honest())


@pytest.mark.parametrize("seed", range(5))
def test_a_model_that_depends_on_time_is_predicted_over_the_steps_that_were_missed(seed: int) -> None:
    demand_missed_steps(Kalman(), Ungm(), Squared(), seed)
    with pytest.raises(AssertionError, match=r"scene\.steps was 5"):
        demand_missed_steps(OneStepWithPrevious(), Ungm(), Squared(), seed)


@part
class OneStepWithPrevious(Kalman):
    """It predicts one step from the time one step ago."""

    def predicted(self, belief, scene, steps, time):
        return super().predicted(belief, scene, min(steps, 1), scene.previous)


def test_what_differs_between_the_trials_is_time_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one step in each trial, every tracker is the same in all of them: the check compares nothing else."""
    monkeypatch.setattr(missed_steps_check, "MISSED", missed_steps_check.ONE)
    demand_missed_steps(Kalman(), ConstantVelocity(), AcousticEnergy(), 1)
