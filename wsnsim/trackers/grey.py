"""GMTT: a fix by least squares at each step, and a grey model of the last fixes that says where the next will be.

What a step asks:

    Gather: readings  Compute
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.asks import Compute
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Estimate, Scene
from wsnsim.kernels.grey import equal_intervals, forecast
from wsnsim.trackers.shared.localising import Fixes, RangeFix

LEAST_FIXES: Final = 4
"""Fewer give no prediction."""
POSITION_BITS: Final = 32
HEADER_BITS: Final = 104


@part
class GreyTracking(RangeFix):
    """Least squares on the ranges, and GM(1,1) on each axis of the last `window` fixes, which predicts the next.

    Fixes come at unequal times: Ψ interpolates them at equal ones, and the model is evaluated at the fractional index
    of the instant that is asked for. A prediction is kept in the field. Fewer than four fixes predict nothing: the
    target is expected where it was last. The message of the paper has no times: that a head knows those of the fixes it
    is sent is an idealisation.

    GM(1,1) is not invariant to the origin, and explodes on mixed signs: `shift` is added before and subtracted after;
    0 is literal. `correction`, where the model's check fails: `literal` is a model of the residuals of which the first
    is 0, `tail` our repair, a model of the others. `report`: what is issued, the fix or what was predicted for the
    step.

    Source: Li, Jiang, Zhang, Zhang (2012). The window of 5 is implied by the message's 20 bytes at 4 a position.
    """

    paper: ClassVar[str] = "Li, Jiang, Zhang, Zhang (2012)"
    idea: ClassVar[str] = "least squares on the ranges, and a grey model of the last fixes that predicts the next"
    state: ClassVar[str] = "the last fixes with their times, in the head"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = "correction tail|literal|none, report fix|prediction, shift, window"

    window: Annotated[int, Quantity("", ge=4, le=64), "n: fixes that the model is made of"] = 5
    shift: Annotated[float, Quantity("m", ge=0.0, le=1e7), "added to positions before the model; 0 is literal"] = 500.0
    correction: Annotated[Literal["tail", "literal", "none"], "of a model that fails its check"] = "tail"
    report: Annotated[Literal["fix", "prediction"], "what is issued as the estimate"] = "fix"

    def estimate(self, belief: Fixes) -> Estimate:
        """The fix, or what was predicted for it, with the fix's covariance; the velocity from the last two fixes."""
        if self.report == "fix" or len(belief.points) < LEAST_FIXES:
            return Estimate(belief.mean, belief.cov)
        mean = belief.mean.copy()
        mean[list(belief.place)] = belief.expected
        return Estimate(mean, belief.cov)

    def foresees(self, belief: Fixes) -> bool:
        """Once there are four fixes."""
        return len(belief.points) >= LEAST_FIXES

    def belief_bits(self, belief: Fixes) -> int:
        """The positions' field of figure 1: 4 bytes each, 20 for five."""
        return self.window * POSITION_BITS

    @property
    def _handover_bits(self) -> int:
        return HEADER_BITS + self.window * POSITION_BITS

    @property
    def _kept(self) -> int:
        return self.window

    def _at(self, belief: Fixes, time: float, scene: Scene) -> Floats:
        """(2,) the grey model's position at a time after the last fix, in the field."""
        points = np.array(belief.points)
        if len(points) < LEAST_FIXES or time <= belief.times[-1]:
            return points[-1]
        spacing = (belief.times[-1] - belief.times[0]) / (len(points) - 1)
        ahead = (time - belief.times[-1]) / spacing
        found = [
            forecast(equal_intervals(belief.times, axis)[1], ahead, self.shift, self.correction) for axis in points.T
        ]
        return _kept_in(np.array(found), scene)

    def _compute(self, fixing: float, fixes: int) -> Compute:
        """The fix, and the model on two axes (see `grey_cycles`)."""
        return Compute(fixing + (2.0 * grey_cycles(min(fixes, self.window)) if fixes >= LEAST_FIXES else 0.0))


def grey_cycles(n: int) -> float:
    """Operations of one axis: Ψ 9 a fix; sums 8 a fix, and their solution 20; the model 47; its check 30 a fix, and 14;
    the correction's sums and model again 8 a fix, and 67. Weighted as in `shared.localising`.
    """
    return 55.0 * n + 148.0


def _kept_in(point: Floats, scene: Scene) -> Floats:
    """The point, or the nearest one of the field."""
    half = np.array([scene.field.width, scene.field.height]) / 2.0
    centre = np.array(scene.field.centre)
    inside: Floats = np.clip(point, centre - half, centre + half)
    return inside
