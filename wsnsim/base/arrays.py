"""Array types used across packages. States are (D, N): column j is particle j."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Keys: TypeAlias = NDArray[np.uint64]
Bools: TypeAlias = NDArray[np.bool_]


def planar(points: Floats) -> Floats:
    """Points (n, P) as points (n, 2) in the plane.

    Points with one coordinate lie on the x-axis; of points with three the height is left out.
    """
    if points.shape[-1] == 2:
        return points
    if points.shape[-1] == 3:
        return points[..., :2]
    return np.concatenate([points, np.zeros_like(points)], axis=-1)


def stateful(states: Floats, columns: int) -> Floats:
    """States (D, N) as a contiguous array for kernels. `columns`: number of state columns of the model."""
    assert states.shape[0] == columns, f"states have {states.shape[0]} rows, the model has {columns} state columns"
    return np.ascontiguousarray(states)


def scalars(array: Any) -> Any:
    """A view of a contiguous array whose items are Python numbers: indexing is three times as fast.

    Writing to the view writes to the array.
    """
    return memoryview(array)
