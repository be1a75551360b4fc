"""Limits of values, random samples and counts that several models share.

Limits are beyond any network, and small enough that no product overflows. All are our choice.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.errors import RunError
from wsnsim.base.part import Quantity
from wsnsim.base.rng import normals

LOG_TWO_PI: Final = math.log(2.0 * math.pi)
MOST_NODES: Final = 10_000_000
LENGTH: Final = Quantity("m", ge=1e-3, le=1e7)
"""A side of the field, or a range."""
POSITION_ERROR: Final = Quantity("m", ge=0, le=1e6)
"""Standard deviation of what is believed of a node's position, per axis."""
PLACE: Final = Quantity("m", ge=-1e7, le=1e7)
"""A coordinate of a position."""
STATE: Final = Quantity("", ge=-1e7, le=1e7, label="SI")
"""A column of a state, in SI units."""
DEVIATION: Final = Quantity("", ge=1e-6, le=1e7, label="SI")
"""The standard deviation of a column of a state."""
LEVEL: Final = Quantity("dBm", ge=-200.0, le=60.0)
"""A power of radio."""
POWER_OF_SOUND: Final = Quantity("", ge=1e-12, le=1e18)
"""An energy of a signal or of noise, in any unit."""


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


def number_of_nodes(deploy: Any) -> int | None:
    """The number of nodes of a deployment; None if they cannot be placed, which the deployment says itself."""
    count = getattr(deploy, "nodes", None)
    if count is not None:
        return int(count)
    try:
        return len(deploy.draw(math.inf, np.random.default_rng(0)))
    except RunError:
        return None
