"""Bit error rates of modulations, and the probability that a frame arrives, by the signal-to-noise ratio.

bit_error(ratio, modulation) -> probability    snr_for(probability, bits, modulation) -> ratio (its inverse)
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final, Literal, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats

Modulation: TypeAlias = Literal["oqpsk", "ncfsk"]
_K: Final = np.arange(2, 17)
_RATES: Final = 20.0 * (1.0 / _K - 1.0)
_WEIGHTS: Final = np.array([(-1) ** k * math.comb(16, k) for k in _K.tolist()]) / 30.0
_MOST_RATIO: Final = 1e3
"""Above this ratio the bit error rate is zero: exp(-500)."""


def bit_error(ratio: Floats, modulation: Modulation) -> Floats:
    """Return the probability of a bit error at ratios (not in dB) of signal to noise and interference.

    O-QPSK with 16 chip sequences: 8/15 · 1/16 · Σ_{k=2}^{16} (-1)^k C(16, k) exp(20 ratio (1/k - 1)).
    Non-coherent FSK: exp(-ratio / 2) / 2.

    Source: IEEE 802.15.4-2006, E.4.1.8, eq. 7; Proakis, "Digital communications", for FSK.
    """
    ratio = np.asarray(np.minimum(ratio, _MOST_RATIO))
    if modulation == "ncfsk":
        return 0.5 * np.exp(-0.5 * ratio)
    wrong = np.exp(ratio[..., None] * _RATES) @ _WEIGHTS
    return np.maximum(wrong, 0.0)


def success(error: Floats, bits: float) -> Floats:
    """Return the probability that none of the bits is wrong."""
    return np.exp(bits * np.log1p(-error))


@cache
def snr_for(probability: float, bits: float, modulation: Modulation) -> float:
    """Return the signal-to-noise ratio at which a frame of this length arrives with a probability (by bisection)."""
    low, high = 0.0, _MOST_RATIO
    for _ in range(200):
        middle = 0.5 * (low + high)
        arrives = float(success(bit_error(np.array(middle), modulation), bits))
        low, high = (middle, high) if arrives < probability else (low, middle)
    return high


def snr_at_sensitivity(modulation: Modulation) -> float:
    """Return the signal-to-noise ratio at which 1 % of PSDUs of 20 bytes are lost (IEEE 802.15.4-2006, 6.1.7)."""
    return snr_for(0.99, 160, modulation)
