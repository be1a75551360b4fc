"""RIS as a tracker: at each step, a least-squares fix from the nodes that happen to be awake.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.part import part
from wsnsim.base.ports import Scene
from wsnsim.trackers.shared.fixes import Fixes, Ranged, RangeFix

HANDOVER_BITS = 88
"""Size of the last fix, as in a report: 11 bytes."""
POSITION_BITS = 32


@part
class AwakeOnly(RangeFix):
    """A least-squares fix from the ranges of the nodes that are awake, without prediction or memory.

    The search for the fix starts at the mean position of the nodes whose readings arrived. So the fix from one range is
    the position of its node, and that from two ranges is the midpoint of their intersections, since nothing selects
    one. The velocity is unknown. This is the reference for trackers with a wake-up protocol.

    Source: the random independent sleeping of Li, Jiang, Zhang, Zhang (2012), without its wake-up; our choice.
    """

    def foresees(self, belief: Fixes) -> bool:
        """Never."""
        return False

    def belief_bits(self, belief: Fixes) -> int:
        """One position of 4 bytes."""
        return POSITION_BITS

    @property
    def _handover_bits(self) -> int:
        return HANDOVER_BITS

    @property
    def _kept(self) -> int:
        return 1

    def _start_of(self, expected: Estimate, ranged: Ranged, scene: Scene) -> tuple[Floats, float]:
        return np.asarray(ranged.seen.positions.mean(axis=0)), float(ranged.ranges.max())

    def _other_cycles(self, fixes: int) -> float:
        return 0.0
