"""Points in the plane sorted into square cells, so that those near a place are found without looking at all.

    grid.within(point, radius) -> ids    grid.within_each(points, radius) -> (rows, ids)    grid.nearest(point) -> id

It finds what SciPy's k-d tree finds and is built in a quarter of the time. It needs NumPy only: the import of
`scipy.spatial` takes longer than a short run.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints, scalars

PER_CELL: Final = 16
"""Mean number of points in a cell: fewer cost more slices, more cost more distances."""
DENSE: Final = 0.25
"""Share of the cells that a search looks at, from which on it computes the distances of all points."""
CANDIDATES: Final = 200_000
"""Distances that are computed at once if points are spread evenly: bounds the memory."""
MOST: Final = 4
"""This many times as many distances are computed at once at most, but for a single place."""
ROUNDING: Final = 1e-6
"""Share of a cell, and of the radius, by which a search is widened. The distances decide, exactly."""


class CellGrid:
    """A grid of square cells over points.

    Args:
        positions: (N, 2) the points, at least one, all finite. They must not change.
    """

    def __init__(self, positions: Floats) -> None:
        self.positions = positions
        self.x, self.y = (np.ascontiguousarray(positions[:, i], dtype=np.float64) for i in range(2))
        self._left, self._low = float(self.x.min()), float(self.y.min())
        width, height = float(self.x.max()) - self._left, float(self.y.max()) - self._low
        cells = max(len(positions) / PER_CELL, 1.0)
        self._side = max((width * height / cells) ** 0.5, width / cells, height / cells) or 1.0
        self._columns, self._rows = int(width / self._side) + 1, int(height / self._side) + 1
        cell = self._row(self.y)
        cell *= self._columns
        cell += self._column(self.x)
        self._order: Ints = np.argsort(cell, kind="stable")
        counts = np.bincount(cell, minlength=self._columns * self._rows)
        self._starts = np.concatenate(([0], np.cumsum(counts)))
        self._start = scalars(self._starts)

    def within(self, point: tuple[float, float] | Floats, radius: float) -> Ints:
        """(n,) the points whose distance from a place is at most `radius`, ascending."""
        x, y = float(point[0]), float(point[1])
        reach, columns, start, order = self._widened(radius), self._columns, self._start, self._order
        first, last = self._between(x - self._left, reach, columns)
        low, high = self._between(y - self._low, reach, self._rows)
        rows = range(low * columns, (high + 1) * columns, columns)
        found = np.concatenate([order[start[row + first] : start[row + last + 1]] for row in rows])
        dx, dy = self.x[found] - x, self.y[found] - y
        near: Ints = found[dx * dx + dy * dy <= radius * radius]
        near.sort()
        return near

    def within_each(self, points: Floats, radius: float) -> tuple[Ints, Ints]:
        """The points within `radius` of each of several places.

        Args:
            points: (T, 2) the places.
            radius: the largest distance.

        Returns:
            Pairs of a place (row of `points`) and a point, as two arrays (n,), in ascending order.
        """
        span = 2.0 * self._widened(radius) / self._side + 2.0
        share = min(span / self._columns, 1.0) * min(span / self._rows, 1.0)
        size = max(int(CANDIDATES / (share * len(self.positions))), 1)
        search = self._pairs if share < DENSE else self._all_pairs
        found = [(first, *search(points[first : first + size], radius)) for first in range(0, len(points), size)]
        none = np.empty(0, dtype=np.int64)
        rows = np.concatenate([none, *(first + rows for first, rows, _ in found)])
        return rows, np.concatenate([none, *(ids for _, _, ids in found)])

    def links(self, radius: float) -> tuple[Ints, Ints]:
        """All pairs of different points that are at most `radius` apart, in both directions, in ascending order."""
        sources, ends = self.within_each(self.positions, radius)
        different = sources != ends
        return sources[different], ends[different]

    def nearest(self, point: Floats) -> int:
        """The point nearest to a place. Of equally near ones, it is the one that SciPy's k-d tree finds."""
        squares = ((self.positions - point) ** 2).sum(axis=1)
        nearest = np.flatnonzero(squares == squares.min())
        if nearest.size == 1:
            return int(nearest[0])
        from scipy.spatial import KDTree  # slow to import, and needed in regular grids only

        return int(KDTree(self.positions).query(point)[1])

    def _all_pairs(self, points: Floats, radius: float) -> tuple[Ints, Ints]:
        """What `within_each` returns, from the distances of all pairs: faster where the radius spans many cells."""
        dx, dy = points[:, :1] - self.x, points[:, 1:] - self.y
        dx *= dx
        dy *= dy
        dx += dy
        return np.divmod(np.flatnonzero(dx <= radius * radius), self.x.size)

    def _pairs(self, points: Floats, radius: float) -> tuple[Ints, Ints]:
        """What `within_each` returns, from the cells around each place."""
        reach, (x, y) = self._widened(radius), points.T
        first, last = self._column(x - reach), self._column(x + reach) + 1
        places, rows = ranges(self._row(y - reach), self._row(y + reach) + 1)
        rows *= self._columns
        begins, ends = self._starts[rows + first[places]], self._starts[rows + last[places]]
        if len(points) > 1 and int((ends - begins).sum()) > MOST * CANDIDATES:
            return self._halves(points, radius)
        slices, found = ranges(begins, ends)
        owners, ids = places[slices], self._order[found]
        dx, dy = x[owners] - self.x[ids], y[owners] - self.y[ids]
        near = dx * dx + dy * dy <= radius * radius
        keys = owners[near] * self.x.size + ids[near]
        keys.sort()
        return np.divmod(keys, self.x.size)

    def _halves(self, points: Floats, radius: float) -> tuple[Ints, Ints]:
        """What `_pairs` returns, from two searches: where points stand in clusters, some cells hold many."""
        middle = len(points) // 2
        (rows, ids), (others, other_ids) = (self._pairs(half, radius) for half in (points[:middle], points[middle:]))
        return np.concatenate([rows, others + middle]), np.concatenate([ids, other_ids])

    def _column(self, x: Floats) -> Ints:
        """(n,) the columns of cells at coordinates; those outside are moved to the edge."""
        return np.clip((x - self._left) / self._side, 0.0, self._columns - 1.0).astype(np.int64)

    def _row(self, y: Floats) -> Ints:
        """(n,) the rows of cells at coordinates; those outside are moved to the edge."""
        return np.clip((y - self._low) / self._side, 0.0, self._rows - 1.0).astype(np.int64)

    def _between(self, centre: float, reach: float, cells: int) -> tuple[int, int]:
        """The first and the last column, or row, of cells that a search looks at; `centre` counts from the edge."""
        first, last = (centre - reach) / self._side, (centre + reach) / self._side
        return int(min(max(first, 0.0), cells - 1.0)), int(min(max(last, 0.0), cells - 1.0))

    def _widened(self, radius: float) -> float:
        """A radius that rounding does not make too small."""
        return radius * (1.0 + ROUNDING) + self._side * ROUNDING


def ranges(begins: Ints, ends: Ints) -> tuple[Ints, Ints]:
    """All numbers of several ranges: (index of the range, number) as two arrays, range by range."""
    sizes = ends - begins
    index = np.repeat(np.arange(sizes.size), sizes)
    numbers = np.arange(index.size)
    numbers += np.repeat(begins - np.concatenate(([0], np.cumsum(sizes)[:-1])), sizes)
    return index, numbers
