"""The names of the traits of nodes' sensors that more than the sensor model knows.

gain_factors(names, traits) -> (N,)      gain_column(names) -> column or None
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats

GAIN: Final = "gain"
"""A factor of a sensor's readings, or of the signal in them."""
GAIN_DB: Final = "gain_db"
"""What is added to a sensor's readings of received power, in dB."""
HEIGHT: Final = "height"
"""The height of a node in m, from the deployment."""


def gain_factors(names: tuple[str, ...], traits: Floats) -> Floats:
    """(N,) the gain of each node as a factor, from traits (N, T): 1 where sensors have none, 10^(g/10) for g in dB."""
    if GAIN in names:
        gains: Floats = traits[:, names.index(GAIN)]
        return gains
    if GAIN_DB in names:
        factors: Floats = 10.0 ** (traits[:, names.index(GAIN_DB)] / 10.0)
        return factors
    return np.ones(len(traits))


def has_gains(sensor: Any) -> bool:
    """Whether the nodes of a sensor model differ in gain, or would if its spread were not 0."""
    return gain_column(sensor.trait_names) is not None or hasattr(sensor, "gain_spread")


def gain_column(names: tuple[str, ...]) -> int | None:
    """The column of the gain among a sensor's traits; None if sensors have no gain."""
    return next((column for column, name in enumerate(names) if name in (GAIN, GAIN_DB)), None)
