"""The same charge for several nodes, in one pass over them.

    book(nodes, joules, spent, spent_on)                  the energy ledger
    mark_busy(nodes, seconds, busy, modes, ...)           background consumption

For the few neighbours of a sender each is several times as fast as the same in array operations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wsnsim.kernels.arrays import Floats, Ints
from wsnsim.kernels.compilation import exact_kernel, kernel


@kernel
def book(nodes: Ints, joules: float, spent: Floats, spent_on: Floats) -> None:
    """Add joules to what different nodes (n,) have spent (N,), and to what they have spent on one cause (N,)."""
    for i in range(nodes.size):
        spent[nodes[i]] += joules
        spent_on[nodes[i]] += joules


@exact_kernel
def mark_busy(
    nodes: Ints, seconds: float, busy: Floats, modes: NDArray[np.int8], counts: Ints,
    powers: Floats, causes: Ints, totals: Floats,
) -> None:  # fmt: skip
    """Add seconds to the time for which the radios of different nodes (n,) were busy (N,).

    What they would have consumed in that time is subtracted from the network's totals, mode by mode.

    Args:
        nodes: (n,) the nodes.
        seconds: The time in s.
        busy: (N,) the time of all nodes in s.
        modes: (N,) the mode of each node.
        counts: (modes,) in which is written how many of the nodes are in each mode.
        powers: (modes,) the power of a radio in each mode, in W.
        causes: (modes,) on which it is booked.
        totals: (causes,) the network's totals in J.
    """
    counts[:] = 0
    for i in range(nodes.size):
        busy[nodes[i]] += seconds
        counts[modes[nodes[i]]] += 1
    for mode in range(counts.size):
        if counts[mode] > 0:
            totals[causes[mode]] -= powers[mode] * seconds * counts[mode]
