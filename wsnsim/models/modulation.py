"""How often a bit is wrong at a ratio of signal to noise, and so how often a frame arrives.

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
"""Beyond it no bit is ever wrong: exp(-500)."""


def bit_error(ratio: Floats, modulation: Modulation) -> Floats:
    """Probability that a bit is wrong, at ratios (not dB) of signal to noise and interference.

    O-QPSK with 16 chips' sequences: 8/15 · 1/16 · Σ_{k=2}^{16} (-1)^k C(16, k) exp(20 ratio (1/k - 1)).
    Non-coherent FSK: exp(-ratio / 2) / 2.

    Source: IEEE 802.15.4-2006, E.4.1.8, eq. 7; Proakis, "Digital communications", for FSK.
    """
    ratio = np.minimum(ratio, _MOST_RATIO)
    if modulation == "ncfsk":
        return 0.5 * np.exp(-0.5 * ratio)
    wrong = np.exp(np.multiply.outer(ratio, _RATES)) @ _WEIGHTS
    return np.maximum(wrong, 0.0)


def success(error: Floats, bits: float) -> Floats:
    """Probability that none of so many bits is wrong."""
    return np.exp(bits * np.log1p(-error))


@cache
def snr_for(probability: float, bits: float, modulation: Modulation) -> float:
    """The ratio of signal to noise at which a frame of so many bits arrives with this probability (by bisection)."""
    low, high = 0.0, _MOST_RATIO
    for _ in range(200):
        middle = 0.5 * (low + high)
        arrives = float(success(bit_error(np.array(middle), modulation), bits))
        low, high = (middle, high) if arrives < probability else (low, middle)
    return high


def snr_at_sensitivity(modulation: Modulation) -> float:
    """The ratio of signal to noise at which 1 % of PSDUs of 20 bytes are lost (IEEE 802.15.4-2006, 6.1.7)."""
    return snr_for(0.99, 160, modulation)
