"""The delivery ratio of frames by their power above the sensitivity, as the link `log_normal` has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.fitting.fitted_law import FittedValue
from wsnsim.models.datasheets import bit_error, snr_at_sensitivity, success

CLEAR: Final = 0.9
"""Bursts with at least this delivery ratio have a mean power that is not biased by the packets that were lost."""


def delivery(above: Floats, frame: int) -> Floats:
    """The delivery ratio of frames of so many bytes at powers `above` the sensitivity (dB), without interference."""
    ratio = snr_at_sensitivity("oqpsk") * 10.0 ** (np.asarray(above) / 10.0)
    return success(bit_error(ratio, "oqpsk"), 8.0 * frame)


def margin(frame: int) -> float:
    """The power (dB) above the sensitivity from which bursts are clear."""
    above = np.linspace(-10.0, 20.0, 3001)
    return float(above[np.argmax(delivery(above, frame) >= CLEAR)])


def mean_power(distances: Floats, power: float, values: Mapping[str, FittedValue]) -> Floats:
    """(n,) mean received power in dBm of a transmitter of `power` dBm over these distances, in m."""
    loss, exponent = values["loss_at_1m"].value, values["exponent"].value
    result: Floats = power - loss - 10.0 * exponent * np.log10(np.maximum(distances, 1.0))
    return result
