"""The check of missed steps: a belief is predicted by `scene.steps` model steps, not always by one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Estimate, MotionModel, SensorModel, Tracker
from wsnsim.testing.privacy import same
from wsnsim.testing.table import DT, FIRST, Play, Table

STEPS: Final = 5
"""Model steps since the belief's time at a head that missed all but the last of them."""
LEAST: Final = 1e-9
"""Relative difference of moments from which on they are different, and not only rounded differently."""
MOMENTS: Final = ("mean", "cov")
NEAR: Final = 0.1
"""A mean has been predicted by the model if it is nearer to the model's than this share of the way to it."""
ADVICE: Final = (
    "scene.steps is the number of model steps since the belief's time. Predict as often, from the time scene.since: "
    "for step in range(scene.steps): mean = scene.motion.advance(mean, scene.dt, scene.since + step * scene.dt), and "
    "the covariance beside it; wsnsim.plugins.predicted(mean, cov, scene) does both"
)


@dataclass(frozen=True)
class _Trial:
    """A track of a start and one step. `begin` is the number of the step at which it starts, `steps` those after it.

    Trials differ in times and in nothing else: target, readings and keys are the same.
    """

    begin: int
    steps: int
    dt: float = DT

    def played(self, tracker: Tracker[Any], table: Table, ids: tuple[int, ...]) -> tuple[Estimate, Estimate]:
        """Return the estimates after the start and after the step, at which the members `ids` have a reading."""
        play = Play(table)
        play.lead(FIRST)
        scene = replace(play.scene(0, 0, FIRST), step=self.begin, time=self.begin * DT)
        belief = play.drive(tracker.start(table.prior, scene))
        before, now = tracker.estimate(belief), self.begin + self.steps
        scene = replace(play.scene(1, self.steps, ids), step=now, time=now * DT, dt=self.dt)
        return before, tracker.estimate(play.drive(tracker.step(belief, scene)))


MISSED: Final = _Trial(0, STEPS)
ONE: Final = _Trial(STEPS - 1, 1)
LONGER: Final = _Trial(STEPS - 1, 1, 2.0 * DT)


def demand_missed_steps(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Check that a tracker that predicts does so over the steps that its head missed.

    Of a filter that always predicts one step, the estimate after five steps is that after one, bit for bit, since all
    random numbers are the same. Filters that predict nothing, and models whose states stay, are left alone, and so are
    covariances that a filter holds constant, as an alpha-beta filter does.

    Raises:
        AssertionError: Mean or covariance depend on the motion model, and not on `scene.steps`.
    """
    for ids in ((), FIRST):
        (before, missed), (_, one) = (
            trial.played(tracker, Table(motion, sensor, seed), ids) for trial in (MISSED, ONE)
        )
        equal = [name for name in MOMENTS if same(getattr(missed, name), getattr(one, name))]
        if not equal or (ids and len(equal) < len(MOMENTS)) or not missed.cov.any():
            continue  # readings may decide the mean alone, and a cloud of one particle has no covariance
        _, longer = LONGER.played(tracker, Table(motion, sensor, seed), ids)
        after_one, after_all = _advanced(motion, before, ONE), _advanced(motion, before, MISSED)
        moved = {
            "mean": not ids and _near(before, one, after_one),
            "cov": not ids and _differ(before.cov, one.cov),
        }
        for name in equal:
            expected, found = getattr(after_all, name), getattr(missed, name)
            depends = moved[name] or _differ(getattr(longer, name), found)
            assert not (depends and _differ(expected, getattr(after_one, name))), _message(name, ids, found, expected)


def _advanced(motion: MotionModel, estimate: Estimate, trial: _Trial) -> Estimate:
    """Return the estimate after the steps of a trial, by the linearised motion model."""
    mean, cov = estimate.mean[:, None], estimate.cov
    for step in range(trial.steps):
        time = (trial.begin + step) * DT
        transitions, noise = motion.matrices(mean, DT, time)
        mean, cov = motion.advance(mean, DT, time), transitions[0] @ cov @ transitions[0].T + noise
    return Estimate(mean[:, 0], cov)


def _near(before: Estimate, found: Estimate, expected: Estimate) -> bool:
    """Whether a step without readings moved the mean as one step of the model does."""
    way = np.linalg.norm(expected.mean - before.mean)
    return bool(way > 0.0 and np.linalg.norm(found.mean - expected.mean) < NEAR * way)


def _differ(one: Floats, other: Floats) -> bool:
    """Whether two moments are different."""
    return not np.allclose(one, other, rtol=LEAST, atol=LEAST * float(np.abs(one).max(initial=0.0)))


def _message(name: str, ids: tuple[int, ...], found: Floats, expected: Floats) -> str:
    what = "mean" if name == "mean" else "covariance"
    diagonal = (found, expected) if name == "mean" else (np.diag(found), np.diag(expected))
    shown, wanted = (np.array2string(values, precision=4) for values in diagonal)
    shown, wanted = (text if name == "mean" else f"diagonal {text}" for text in (shown, wanted))
    readings = "with the readings of all members" if ids else "without a reading"
    by_model = "" if ids else f" (by the motion model {wanted})"
    return (
        f"the head missed {STEPS - 1} steps and then made one, {readings}: scene.steps was {STEPS}. The {what} was "
        f"expected to be predicted over {STEPS} steps{by_model}; it is that of scene.steps = 1, bit for bit: {shown}. "
        f"{ADVICE}"
    )
