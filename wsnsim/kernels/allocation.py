"""How many particles each active member gets."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wsnsim.kernels.noise import SWITCHES


@njit(**SWITCHES)
def allocate(total: int, active: int) -> NDArray[np.int64]:
    """(active,) particles for each active member: what is left, divided by those still to be served, rounded down.

    The shares are floor or ceiling of total / active and sum to `total` exactly. No member, no share.
    Jiang (2013), eq. (25).
    """
    shares = np.empty(active, np.int64)
    dealt = 0
    for i in range(active):
        shares[i] = (total - dealt) // (active - i)
        dealt += shares[i]
    return shares
