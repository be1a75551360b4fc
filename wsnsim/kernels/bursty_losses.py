"""The states of links whose losses come in bursts: a Markov chain of two states in continuous time.

    advance(keys, durations, time, good, until, counts)      to the states at a time

The random numbers are those of `base.rng`, so that the states at a time do not depend on when they were looked at.
"""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Bools, Floats, Ints, Keys
from wsnsim.kernels.compilation import kernel
from wsnsim.kernels.noise import uniform


@kernel
def advance(keys: Keys, durations: Floats, time: float, good: Bools, until: Floats, counts: Ints) -> float:
    """Advance the states of links (n,) to a time; returns the time in s of the next change of any of them.

    A state lasts for an exponentially distributed time, the k-th of a link by the k-th uniform number of its key.

    Args:
        keys: (n,) random keys.
        durations: (n, 2) mean duration in s of a bad and of a good state.
        time: The time in s, not before that of an earlier call.
        good: (n,) whether the link is in a good state; changed.
        until: (n,) end of the state in s; changed.
        counts: (n,) random numbers that were used; changed.
    """
    following = np.inf
    for i in range(keys.size):
        while until[i] <= time:
            good[i] = not good[i]
            until[i] -= durations[i, int(good[i])] * np.log1p(-uniform(keys[i], counts[i]))
            counts[i] += 1
        following = min(following, until[i])
    return following
