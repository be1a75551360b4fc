"""Random samples that several models share."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.rng import normals

MOST_DEVIATIONS: Final = 3.0
"""Standard deviations at which a normal is truncated (our choice): 0.27 % of the samples are repeated."""


def truncated_normals(keys: Keys) -> Floats:
    """(n,) standard normals, one per key, truncated at ±3: a sample beyond is replaced by the key's next one."""
    draws = normals(keys, 0)
    beyond, turn = np.flatnonzero(np.abs(draws) > MOST_DEVIATIONS), 1
    while beyond.size:
        draws[beyond] = normals(keys[beyond], turn)
        beyond, turn = beyond[np.abs(draws[beyond]) > MOST_DEVIATIONS], turn + 1
    return draws
