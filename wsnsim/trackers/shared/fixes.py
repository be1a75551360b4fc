"""Base of trackers that compute a fix at each step by least squares on ranges.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.requests import Compute, Flow, Parcel, Send
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.heads import HeadFilter
from wsnsim.trackers.shared.localising import Fix, Point, Ranged, fix_cycles, fixed, usable
from wsnsim.trackers.shared.moments import forecast, predicted
from wsnsim.trackers.shared.readings import gather_readings


@dataclass(frozen=True, slots=True)
class Fixes:
    """The last fixes: `times` (n,) in s and `points`, oldest first; and the moments of the whole state now.

    `last_cov` (2, 2) is of the last fix. `unknown` (D,): variances of what ranges do not tell, from the prior.
    `foretold`: what had been predicted for the last step, None if nothing was.
    """

    times: tuple[float, ...]
    points: tuple[Point, ...]
    mean: Floats
    cov: Floats
    head: int
    last_cov: Floats
    unknown: Floats
    foretold: Estimate | None = None
    effective: float = float("nan")


@part
class RangeFix(HeadFilter):
    """Base of trackers that compute a fix at each step by least squares on the ranges that arrived.

    A subclass defines the expected position (`_at`), the start of the search (`_start_of`), the number of fixes that it
    keeps, the bits of a handover, and its operations other than the fix. Columns of the state other
    than the position are the velocity, from the last two fixes, if they are named vx and vy, and else unknown: 0 with
    the prior's spread. The position that a track starts with counts as its first fix (our choice).
    """

    needs: ClassVar[tuple[str, ...]] = ("ranges",)
    """Methods that its sensor must have in addition to the port's."""
    angles: ClassVar[bool] = False
    vector_readings: ClassVar[bool] = False

    reading_bits: Annotated[int, Quantity("", ge=1, le=100_000, label="bit"), "bits of a reading on the air"] = 88

    def start(self, prior: Estimate, scene: Scene) -> Flow[Fixes]:
        """The prior, whose position is the first fix."""
        place = _both(*scene.motion.position)
        x, y = prior.mean[place].tolist()
        unknown = np.diag(prior.cov) + prior.mean**2
        return Fixes(
            (scene.time,), ((x, y),), prior.mean, prior.cov, scene.head, prior.cov[place, place].copy(), unknown
        )
        yield  # a flow without requests

    def step(self, belief: Fixes, scene: Scene) -> Flow[Fixes]:
        """One step: N_act - 1 measurements reach the head, which computes a fix; without any, it predicts."""
        ranged = usable((yield from gather_readings(scene, self.reading_bits)), scene)
        expected = self._placed(Estimate(*predicted(belief.mean, belief.cov, scene)), belief, scene.time, scene)
        count = ranged.ranges.size
        if not count:
            yield Compute(self._other_cycles(len(belief.points)))
            foretold = expected if self._predicts(belief) else None
            return replace(belief, mean=expected.mean, cov=expected.cov, head=scene.head, foretold=foretold)
        fix = fixed(ranged, *self._start_of(expected, ranged, scene), scene)
        fixes = min(len(belief.points) + 1, self._kept)
        yield Compute(fix_cycles(count, fix.iterations) + self._other_cycles(fixes))
        return self._with(belief, fix, expected, scene)

    def hand_over(self, belief: Fixes, scene: Scene, successor: int) -> Flow[Fixes | None]:
        """One packet with the fixes, or nothing. The moments of the state follow from the fixes and the models."""
        payload = belief.times, belief.points, belief.last_cov
        mask = yield Send(successor, Parcel(payload, 1, self._handover_bits, "handover"))
        return replace(belief, head=successor) if mask.all() else None

    def forecast(self, belief: Fixes, scene: Scene, ahead: int) -> Estimate:
        """The expected position `ahead` steps later, with the covariance of the motion model's prediction."""
        moved = forecast(Estimate(belief.mean, belief.cov), scene, ahead)
        return self._placed(moved, belief, scene.time + ahead * scene.dt, scene)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """The position of the motion model must have two columns."""
        if any(len(motion.position) != 2 for motion in setup.filter_motions):
            yield Issue(
                ("tracker", "kind"),
                "a fix from ranges needs a motion model whose position has two columns, such as constant_velocity",
            )

    @property
    def _kept(self) -> int:
        """Number of fixes that are kept."""
        raise NotImplementedError

    @property
    def _handover_bits(self) -> int:
        raise NotImplementedError

    def _other_cycles(self, fixes: int) -> float:
        """Operations of a step other than the fix, given the number of kept fixes."""
        raise NotImplementedError

    def _predicts(self, belief: Fixes) -> bool:
        """Whether it predicts the position, instead of keeping the last one."""
        return False

    def _at(self, belief: Fixes, time: float, scene: Scene) -> Floats:
        """(2,) the expected position at a time: by default the last fix."""
        return np.array(belief.points[-1])

    def _start_of(self, expected: Estimate, ranged: Ranged, scene: Scene) -> tuple[Floats, float]:
        """(2,) from where the fix is searched, and how far in m the target is from there: as expected.

        No farther than the longest range says.
        """
        x, y = scene.motion.position
        off = math.sqrt(float(expected.cov[x, x] + expected.cov[y, y]))
        return expected.mean[_both(x, y)], min(off, float(ranged.ranges.max()))

    def _placed(self, moved: Estimate, belief: Fixes, time: float, scene: Scene) -> Estimate:
        """The motion model's prediction, moved to the expected position; the difference is added to the covariance."""
        place = _both(*scene.motion.position)
        mean, cov = moved.mean.copy(), moved.cov.copy()
        mean[place] = self._at(belief, time, scene)
        off = moved.mean[place] - mean[place]
        cov[place, place] += off[:, None] * off
        return Estimate(mean, cov)

    def _with(self, belief: Fixes, fix: Fix, expected: Estimate, scene: Scene) -> Fixes:
        """The belief with one more fix; of two at one time the later."""
        x, y = fix.point.tolist()
        earlier = [(time, point) for time, point in zip(belief.times, belief.points, strict=True) if time < scene.time]
        kept = [*earlier, (scene.time, (x, y))][-self._kept :]
        times, points = tuple(time for time, _ in kept), tuple(point for _, point in kept)
        mean, cov = _state(times, points, (belief.last_cov, fix.cov), belief.unknown, scene)
        foretold = expected if self._predicts(belief) else None
        return Fixes(times, points, mean, cov, scene.head, fix.cov, belief.unknown, foretold)


def _both(first: int, second: int) -> slice:
    """The slice of two rows, in this order: a view, which an index by a list is not."""
    step = second - first
    stop = second + (1 if step > 0 else -1)
    return slice(first, stop if stop >= 0 else None, step)


def _state(
    times: tuple[float, ...], points: tuple[Point, ...], covs: tuple[Floats, Floats], unknown: Floats, scene: Scene
) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of the state that two independent fixes tell, `covs` their covariances."""
    columns, place = scene.motion.columns, _both(*scene.motion.position)
    mean, cov = np.zeros(len(columns)), np.diag(unknown)
    mean[place] = points[-1]
    cov[place, place] = covs[1]
    if len(times) > 1 and "vx" in columns and "vy" in columns:
        moving, passed = _both(columns.index("vx"), columns.index("vy")), times[-1] - times[-2]
        (x, y), (last_x, last_y) = points[-1], points[-2]
        mean[moving] = (x - last_x) / passed, (y - last_y) / passed
        cov[moving, moving] = (covs[0] + covs[1]) / passed**2
        cov[place, moving] = cov[moving, place] = covs[1] / passed
    return mean, cov
