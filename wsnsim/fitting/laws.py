"""The laws that can be fitted to readings: what each expects as a linear function of its coefficients.

LAWS["rssi"].design(distances (n,)) -> (n, C)      expectation = offset + design @ coefficients (+ gain of the node)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.models.ranging import GREATEST_RANGE
from wsnsim.models.rssi import Rssi

LEAST_RANGE: Final = -100.0
"""Least range (m) that is fitted (our choice): that of the sensor `range` with sd = 10 m; sd is not known yet."""


class Coefficient(NamedTuple):
    """A coefficient of a law: its key in the scenario, its unit, and what it is."""

    name: str
    unit: str
    about: str


class LawForm(NamedTuple):
    """A law whose expected reading is linear in its coefficients.

    Attributes:
        kind: of the sensor in a scenario.
        unit: of the residuals.
        reading_unit: of the readings.
        coefficients: one for each column of the design; the first is a constant.
        design: (n,) distances -> (n, C) columns.
        offset: (n,) distances -> (n,) the part of the expectation that has no coefficient.
        gains: whether each node may have its own constant.
        least: the least reading in a file.
        greatest: the greatest reading in a file.
    """

    kind: str
    unit: str
    reading_unit: str
    coefficients: tuple[Coefficient, ...]
    design: Callable[[Floats], Floats]
    offset: Callable[[Floats], Floats]
    gains: bool
    least: float
    greatest: float


def _log_distance(distances: Floats) -> Floats:
    """z0 - 10 η log10(d / 1 m); shorter distances are taken as the floor of the sensor `rssi`."""
    return np.column_stack([np.ones(len(distances)), -10.0 * np.log10(np.maximum(distances, Rssi.floor))])


LAWS: Final = {
    "rssi": LawForm(
        "rssi", "dB", "dBm",
        (Coefficient("z0", "dBm", "strength at 1 m"), Coefficient("eta", "", "exponent of the loss with distance")),
        _log_distance, np.zeros_like, True, *Rssi.reading_limits,
    ),
    "range": LawForm(
        "range", "m", "m", (Coefficient("bias", "m", "mean of reading minus distance"),),
        lambda distances: np.ones((len(distances), 1)), lambda distances: distances, False, LEAST_RANGE, GREATEST_RANGE,
    ),
}  # fmt: skip
"""The laws, by their kind."""
DIRECTIONS: Final = "a bearing is an angle, and no linear function of coefficients"
UNFITTED: Final = {
    "bearing": DIRECTIONS,
    "range_bearing": f"{DIRECTIONS}; a file has one number in a row",
    "acoustic_energy": "its readings are a power of the distance, whose exponent they are not linear in",
}
"""Sensors that cannot be fitted, and why."""
