"""The same charge for several nodes, in one pass over them.

    book(nodes, joules, spent, spent_on)                  the energy ledger
    mark_busy(nodes, seconds, busy, states, ...)          background consumption

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
    nodes: Ints, seconds: float, busy: Floats, states: NDArray[np.int16], counts: Ints,
    powers: Floats, causes: Ints, totals: Floats,
) -> None:  # fmt: skip
    """Add seconds to the time for which the radios of different nodes (n,) were busy (N,).

    What they would have consumed in that time is subtracted from the network's totals, state by state.

    Args:
        nodes: (n,) the nodes.
        seconds: The time in s.
        busy: (N,) the time of all nodes in s.
        states: (N,) the state of each node: its mode, and what its radio does.
        counts: (states,) in which is written how many of the nodes are in each state.
        powers: (states,) the power of a radio in each state, in W.
        causes: (states,) on which it is booked.
        totals: (causes,) the network's totals in J.
    """
    counts[:] = 0
    for i in range(nodes.size):
        busy[nodes[i]] += seconds
        counts[states[nodes[i]]] += 1
    for state in range(counts.size):
        if counts[state] > 0:
            totals[causes[state]] -= powers[state] * seconds * counts[state]
