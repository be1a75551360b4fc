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
BYTES: Final = Quantity("", ge=0, le=127, label="byte")
FRAME_BYTES: Final = Quantity("", ge=1, le=127, label="byte")
"""The length of a frame, at most aMaxPHYPacketSize."""
AIR_BYTES: Final = Quantity("", ge=1, le=133, label="byte")
"""The length of a frame on the air, with what the PHY puts before it."""
PAYLOAD: Final = Quantity("", ge=1, le=1_000_000, label="bit")
BIT_RATE: Final = Quantity("bit/s", ge=1.0, le=1e12)
CLOCK_RATE: Final = Quantity("Hz", ge=1.0, le=1e12)
REPEATS: Final = Quantity("", ge=0, le=100)
BACKOFF_EXPONENT: Final = Quantity("", ge=0, le=16)
COUNT: Final = Quantity("", ge=1, le=1000)
MANY: Final = Quantity("", ge=1, le=10_000)
TICK: Final = Quantity("s", ge=1e-6, le=10.0)
"""A short time above zero, such as that of a frame."""
SPAN: Final = Quantity("s", ge=0.0, le=10.0)
"""A short time."""
SECONDS: Final = Quantity("s", ge=0.0, le=1e6)
DURATION: Final = Quantity("s", gt=0.0, le=1e9)
PERIOD: Final = Quantity("s", ge=1e-3, le=1e6)
LONG_PERIOD: Final = Quantity("s", ge=1e-3, le=1e9)
SPEED: Final = Quantity("m/s", ge=0.0, le=1e6)
JOULES: Final = Quantity("J", ge=0, le=1e6)
PROBABILITY: Final = Quantity("", ge=0.0, le=1.0)
FAILURE: Final = Quantity("", ge=0.0, lt=1.0)
"""The probability of a failure, which is not certain."""
SHARE: Final = Quantity("", gt=0.0, le=1.0)
"""A part of something, more than nothing."""
READING: Final = Quantity("", ge=-1e18, le=1e18, label="as readings")
ACCURACY: Final = Quantity("m", ge=1e-6, le=1e7)
"""A standard deviation of a distance, or a least distance."""
LENGTH: Final = Quantity("m", ge=1e-3, le=1e7)
"""A side of the field, or a range."""
POSITION_ERROR: Final = Quantity("m", ge=0, le=1e6)
"""Standard deviation of what is believed of a node's position, per axis."""
PLACE: Final = Quantity("m", ge=-1e7, le=1e7)
"""A coordinate of a position."""
ELEVATION: Final = Quantity("m", ge=-1e6, le=1e6)
"""A height."""
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
