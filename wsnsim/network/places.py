"""Positions of nodes, where they stand or where others assume them."""

from __future__ import annotations

from wsnsim.base.arrays import Floats, scalars
from wsnsim.base.cell_grid import CellGrid


class Places:
    """Positions of nodes: `positions` (N, 2) in m, single coordinates `x` and `y`, and a `grid` for neighbours."""

    def __init__(self, positions: Floats) -> None:
        self.positions = positions
        self.grid = CellGrid(positions)
        self.x, self.y = scalars(self.grid.x), scalars(self.grid.y)
