"""Names for the array shapes that cross rooms. Structure of arrays: states are (D, N), column j is particle j."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Keys: TypeAlias = NDArray[np.uint64]
Bools: TypeAlias = NDArray[np.bool_]


def planar(points: Floats) -> Floats:
    """Points (n, 2) in the plane of points (n, P): those of one coordinate lie on the x-axis."""
    if points.shape[-1] == 2:
        return points
    return np.concatenate([points, np.zeros_like(points)], axis=-1)


def stateful(states: Floats, columns: int) -> Floats:
    """States (D, N) as kernels take them: contiguous, and of as many rows as the model has columns."""
    assert states.shape[0] == columns, f"states of {states.shape[0]} rows were given to a model of {columns} columns"
    return np.ascontiguousarray(states)


def scalars(array: Any) -> Any:
    """The items of a contiguous array one at a time, as Python's numbers: three times as fast as its own indexing.

    Writing to it writes to the array.
    """
    return memoryview(array)
