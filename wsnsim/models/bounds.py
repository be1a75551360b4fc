"""Limits of values that several models share: beyond any network, and small enough that no product overflows.

All are our choice.
"""

from __future__ import annotations

from typing import Final

from wsnsim.base.part import Quantity

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
POWER_OF_SOUND: Final = Quantity("", ge=1e-12, le=1e18)
"""An energy of a signal or of noise, in any unit."""
