"""Trackers with a least-squares fix at each step, and what they make of the last ones to find the next: Li (2012).

GMTT predicts with a grey model (or a line) of the last fixes. TSSTP samples the nodes that track next, so that no
prediction is needed. RIS has only the nodes that happen to be awake.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.kernels.grey import forecast_at, line_at
from wsnsim.trackers.shared.fixes import Fixes, Ranged, RangeFix

LEAST_FIXES: Final = 4
"""Least number of fixes for a prediction."""
POSITION_BITS: Final = 32
"""4 bytes."""
HEADER_BITS: Final = 104
"""13 bytes: sequence 1, sender 2, target 2, predicted position 4, expiry 4."""
HEADING_CYCLES: Final = 2.0
"""CPU cycles to compute the displacement of the last two fixes."""
TWO_FIXES_BITS: Final = 136
"""Size of the last two fixes, as in the invitation: 17 bytes."""
ONE_FIX_BITS: Final = 88
"""Size of the last fix, as in a report: 11 bytes."""
_forecast_at = lru_cache(maxsize=64)(forecast_at)
"""A prediction is asked for twice: to wake nodes for a step, and in the step."""


@part
class GreyTracking(RangeFix):
    """Least squares on the ranges, and GM(1,1) on each axis of the last `window` fixes, which predicts the next.

    `predictor: linear` is not the paper's: the least-squares line of the same fixes at their own times. `shift` and
    `correction` do not apply to it.

    Fixes have unequal intervals: Ψ interpolates them at equal ones, and the model is evaluated at the fractional index
    of the requested instant. A prediction is limited to the field. With fewer than four fixes the prediction is the
    last fix. The paper's message has no times; that a head knows the times of the fixes it receives is an idealisation.

    GM(1,1) is not invariant to the origin, and diverges on mixed signs: `shift` is added before and subtracted after;
    0 is literal. `correction` applies if the check of the model fails: `literal` is a model of all residuals, of which
    the first is 0; `tail`, our repair, is a model of the others. `report` selects the estimate: the fix, or the
    prediction for the step.

    Source: Li, Jiang, Zhang, Zhang (2012). The window of 5 is implied by the message's 20 bytes at 4 a position.
    """

    window: Annotated[int, Quantity("", ge=4, le=64), "n: number of fixes in the model"] = 5  # type: ignore[misc]
    predictor: Annotated[Literal["grey", "linear"], "model of the fixes: grey (GM(1,1), the paper's), or a line"] = (
        "grey"
    )
    shift: Annotated[float, Quantity("m", ge=0.0, le=1e7), "added to positions before the model; 0 is literal"] = 500.0
    correction: Annotated[Literal["tail", "literal", "none"], "correction of a model that fails its check"] = "tail"
    report: Annotated[Literal["fix", "prediction"], "what is reported as the estimate"] = "fix"

    def estimate(self, belief: Fixes) -> Estimate:
        """The fix, with the velocity from the last two; or what had been predicted for the step, if anything was."""
        if self.report == "prediction" and belief.foretold is not None:
            return belief.foretold
        return Estimate(belief.mean, belief.cov)

    def foresees(self, belief: Fixes) -> bool:
        """Whether there are four fixes."""
        return len(belief.points) >= LEAST_FIXES

    def belief_bits(self, belief: Fixes) -> int:
        """The positions of figure 1: 20 bytes for five. The field has its full length from the first fix on."""
        return self.window * POSITION_BITS

    @property
    def _handover_bits(self) -> int:
        return HEADER_BITS + self.window * POSITION_BITS

    def _other_cycles(self, fixes: int) -> float:
        if fixes < LEAST_FIXES:
            return 0.0
        return 2.0 * (line_cycles(fixes) if self.predictor == "linear" else grey_cycles(fixes, self.correction))

    def _predicts(self, belief: Fixes) -> bool:
        return self.foresees(belief)

    def _at(self, belief: Fixes, time: float, scene: Scene) -> Floats:
        """(2,) the model's position at a time after the last fix, in the field."""
        if not self.foresees(belief) or time <= belief.times[-1]:
            return np.array(belief.points[-1])
        halves, found = (scene.field.width / 2.0, scene.field.height / 2.0), []
        for axis, centre, half in zip(zip(*belief.points, strict=True), scene.field.centre, halves, strict=True):
            value = self._extrapolated(time, belief.times, axis)
            found.append(min(max(value, centre - half), centre + half))
        return np.array(found)

    def _extrapolated(self, time: float, times: tuple[float, ...], axis: tuple[float, ...]) -> float:
        if self.predictor == "linear":
            return line_at(time, times, axis)
        return _forecast_at(time, times, axis, self.shift, self.correction)


@part
class TwoPhase(RangeFix):
    """A least-squares fix at each step; the last fix is the prediction, and the last displacement is the heading.

    A reconstruction: the zones of `wakeup: experience_zones` stand for the published Markov model of the nodes' states.

    Source: Ren, Li, Gao, Cheng (2009), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    _handover_bits: ClassVar[int] = TWO_FIXES_BITS
    window: ClassVar[int] = 2

    def belief_bits(self, belief: Fixes) -> int:
        """Two positions of 4 bytes."""
        return 2 * POSITION_BITS

    def _other_cycles(self, fixes: int) -> float:
        return HEADING_CYCLES if fixes > 1 else 0.0


@part
class AwakeOnly(RangeFix):
    """A least-squares fix from the ranges of the nodes that are awake, without prediction or memory.

    The search for the fix starts at the mean position of the nodes whose readings arrived. So the fix from one range is
    the position of its node, and that from two ranges is the midpoint of their intersections, since nothing selects
    one. The velocity is unknown. This is the reference for trackers with a wake-up protocol.

    Source: the random independent sleeping of Li, Jiang, Zhang, Zhang (2012), without its wake-up; our choice.
    """

    _handover_bits: ClassVar[int] = ONE_FIX_BITS
    window: ClassVar[int] = 1

    def foresees(self, belief: Fixes) -> bool:
        """Never."""
        return False

    def belief_bits(self, belief: Fixes) -> int:
        """One position of 4 bytes."""
        return POSITION_BITS

    def _start_of(self, expected: Estimate, ranged: Ranged, scene: Scene) -> tuple[Floats, float]:
        return np.asarray(ranged.seen.positions.mean(axis=0)), float(ranged.ranges.max())

    def _other_cycles(self, fixes: int) -> float:
        return 0.0


def line_cycles(fixes: int) -> float:
    """Operations of one axis with a line, weighted as in `shared.fixes`; n fixes.

    Means 2 n + 4, deviations 2 n, their products and sums 4 n - 2, the slope 3, the value 3.
    """
    return 8.0 * fixes + 8.0


def grey_cycles(fixes: int, correction: str) -> float:
    """Operations of one axis, weighted as in `shared.fixes`; n fixes.

    Ψ 10 n + 4, the shift n + 1, sums 9 n, their solution 15, the restored model 49. With a correction the check:
    residuals 23 n + 25, and their moments 10 n + 27; and, whether or not it fails, 10 n + 60 for sums and model again
    (our choice: a node keeps the time for it).
    """
    plain = 20.0 * fixes + 69.0
    return plain if correction == "none" else plain + 43.0 * fixes + 112.0
