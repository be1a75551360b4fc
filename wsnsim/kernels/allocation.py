"""How many particles each active member gets."""

from __future__ import annotations

import numpy as np

from wsnsim.kernels.arrays import Ints


def allocate(total: int, active: int) -> Ints:
    """(active,) particles for each active member: what is left, divided by those still to be served, rounded down.

    That gives floor(total / active) to the first and one more to the last total mod active. No member, no share. Plain
    NumPy: it is called too rarely to be worth compiling. Jiang (2013), eq. (25).
    """
    shares = np.full(active, total // max(active, 1), np.int64)
    shares[active - total % max(active, 1) :] += 1
    return shares
