"""Draws that several models share."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.rng import normals

MOST_DEVIATIONS: Final = 3.0
"""Standard deviations at which a truncated normal ends (our choice): 0.27 % of the draws are repeated."""


def truncated_normals(keys: Keys) -> Floats:
    """(n,) standard normals of each key within ±3: a draw beyond is repeated with the key's next one."""
    draws = normals(keys, 0)
    beyond, turn = np.flatnonzero(np.abs(draws) > MOST_DEVIATIONS), 1
    while beyond.size:
        draws[beyond] = normals(keys[beyond], turn)
        beyond, turn = beyond[np.abs(draws[beyond]) > MOST_DEVIATIONS], turn + 1
    return draws
