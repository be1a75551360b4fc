"""The allocation of particles to active members."""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Ints


def allocate(total: int, active: int) -> Ints:
    """(active,) numbers of particles of the active members; empty without members. Jiang (2013), eq. (25).

    Each member gets what is left divided by the members still to be served, rounded down: floor(total / active), and
    one more for the last (total mod active). Plain NumPy, since it is called rarely.
    """
    shares = np.full(active, total // max(active, 1), np.int64)
    shares[active - total % max(active, 1) :] += 1
    return shares
