"""Positions of nodes, where they stand or where others assume them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from wsnsim.base.arrays import Floats, scalars


class Places:
    """Positions of nodes: `positions` (N, 2) in m, single coordinates `x` and `y`, and a `tree` for neighbours."""

    def __init__(self, positions: Floats) -> None:
        self.positions = positions
        self.x, self.y = (scalars(np.ascontiguousarray(positions[:, i], dtype=np.float64)) for i in range(2))
        self.tree = KDTree(positions)
