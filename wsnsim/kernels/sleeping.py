"""Which nodes listen, in one pass over them.

listening(nodes, time, living, awake, begins, ends, held, since, result) -> unknown
"""

from __future__ import annotations

from wsnsim.kernels.arrays import Bools, Floats, Ints
from wsnsim.kernels.compilation import kernel


@kernel
def listening(
    nodes: Ints, time: float, living: Bools, awake: Bools, begins: Floats, ends: Floats, held: Bools, since: Floats,
    result: Bools,
) -> int:  # fmt: skip
    """Find which nodes (n,) are living and have been awake since a time, by schedule or because they were held awake.

    Args:
        nodes: (n,) the nodes.
        time: The time in s.
        living: (n,) which of them are up.
        awake: (N,) what the schedules last said.
        begins: (N,) from when on they said so, in s.
        ends: (N,) until when, in s.
        held: (N,) which nodes are held awake.
        since: (N,) from when on, in s.
        result: (n,) in which the answer is written.

    Returns:
        The number of nodes of which the schedule must be asked first, because what it said is not about this time.
    """
    unknown = 0
    for i in range(nodes.size):
        node = nodes[i]
        if not begins[node] <= time < ends[node]:
            unknown += 1
        result[i] = living[i] and (awake[node] or (held[node] and since[node] <= time))
    return unknown
