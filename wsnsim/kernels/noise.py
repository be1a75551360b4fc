"""Counter-based random numbers: the j-th number of a 64-bit key, without state. `base.rng` is the same in NumPy.

uniform(key, draw) -> float                                  inlined into the kernels that sample
particle_keys(keys, offsets, tag) -> (N,) uint64             one key per particle, from one key per member
sum_of_keys(keys, a, b, c, d) -> uint64                      the sum of derive(key, a, b, c, d)
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Ints, Keys
from wsnsim.kernels.compilation import inlined, kernel

GOLDEN = np.uint64(0x9E37_79B9_7F4A_7C15)
FIRST = np.uint64(0xBF58_476D_1CE4_E5B9)
SECOND = np.uint64(0x94D0_49BB_1331_11EB)
ONE = np.uint64(1)
S11 = np.uint64(11)
S27 = np.uint64(27)
S30 = np.uint64(30)
S31 = np.uint64(31)


@inlined
def mix(x: np.uint64) -> np.uint64:
    """The SplitMix64 finaliser (Steele, Lea, Flood 2014)."""
    x = (x ^ (x >> S30)) * FIRST
    x = (x ^ (x >> S27)) * SECOND
    return x ^ (x >> S31)


@inlined
def uniform(key: np.uint64, draw: int) -> float:
    """The `draw`-th uniform on [0, 1) of a key, with 53 bits."""
    return np.float64(mix(key + (np.uint64(draw) + ONE) * GOLDEN) >> S11) * 2.0**-53


@kernel
def particle_keys(keys: Keys, offsets: Ints, tag: int) -> Keys:
    """(N,) keys: particle j of member m gets derive(keys[m], tag, j - offsets[m]).

    `offsets` is (members + 1,) and ends at N. `tag` separates the purposes that one member's key serves within a step.
    """
    result = np.empty(offsets[-1], np.uint64)
    for m in range(keys.size):
        base = mix(keys[m] + (np.uint64(tag) + ONE) * GOLDEN)
        for j in range(offsets[m], offsets[m + 1]):
            result[j] = mix(base + (np.uint64(j - offsets[m]) + ONE) * GOLDEN)
    return result


@kernel
def sum_of_keys(keys: Keys, a: Ints, b: Ints, c: Ints, d: Ints) -> np.uint64:
    """The sum modulo 2**64 of derive(keys[i], a[i], b[i], c[i], d[i]) over all i; all are (n,)."""
    total = np.uint64(0)
    for i in range(keys.size):
        key = mix(keys[i] + (np.uint64(a[i]) + ONE) * GOLDEN)
        key = mix(key + (np.uint64(b[i]) + ONE) * GOLDEN)
        key = mix(key + (np.uint64(c[i]) + ONE) * GOLDEN)
        total += mix(key + (np.uint64(d[i]) + ONE) * GOLDEN)
    return total
