"""TSSTP: a least-squares fix at each step; the nodes that track next are sampled, so no prediction is needed.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from wsnsim.base.part import part
from wsnsim.trackers.shared.fixes import Fixes, RangeFix

HEADING_CYCLES = 2.0
"""CPU cycles to compute the displacement of the last two fixes."""
HANDOVER_BITS = 136
"""Size of the last two fixes, as in the invitation: 17 bytes."""
POSITION_BITS = 32


@part
class TwoPhase(RangeFix):
    """A least-squares fix at each step; the last fix is the prediction, and the last displacement is the heading.

    A reconstruction: the zones of `wakeup: experience_zones` stand for the published Markov model of the nodes' states.

    Source: Ren, Li, Gao, Cheng (2009), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    def belief_bits(self, belief: Fixes) -> int:
        """Two positions of 4 bytes."""
        return 2 * POSITION_BITS

    @property
    def _handover_bits(self) -> int:
        return HANDOVER_BITS

    @property
    def _kept(self) -> int:
        return 2

    def _other_cycles(self, fixes: int) -> float:
        return HEADING_CYCLES if fixes > 1 else 0.0
