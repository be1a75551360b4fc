"""Counter-based random numbers; logarithm, exponential and normal pairs that the compiler can vectorise.

    uniform(key, draw)         the draw-th number of a 64-bit key, without state; `base.rng` is the same in NumPy
    particle_keys(keys, offsets, tag) -> (N,) uint64       one key per particle, from one key per member

    log(x), exp(y)             one float64 each, within a few units of the last place
    log2(x), exp2(y)           the same to the base two: fewer operations, and closer; for powers, exp2(a * log2(x))
    normal_pair(key, pair)     two standard normals of a counter key (Box-Muller: its cosine and its sine)
    box_muller(u, turn)        the same of two uniforms
    total(row), dot(row, row)  sums over arrays (n,); give slices, since an index that might be negative is slow
    close(squares, x, y, constant, variance)               from sums of squares to log-likelihoods, in place

All but `particle_keys` are inlined into the kernels that use them, where Numba's own call the C library. Numba's cache
does not notice a change in this file: touch the files of the kernels, too.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.kernels.compilation import inlined, inner, kernel, ordered_inlined

GOLDEN = np.uint64(0x9E37_79B9_7F4A_7C15)
FIRST = np.uint64(0xBF58_476D_1CE4_E5B9)
SECOND = np.uint64(0x94D0_49BB_1331_11EB)
ONE = np.uint64(1)
LOG_TWO_PI = 1.8378770664093453
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


ONE_BITS = np.int64(0x3FF0_0000_0000_0000)
SQRT_HALF_BITS = np.int64(0x3FE6_A09E_667F_3BCD)
EXPONENT_BITS = np.int64(0x7FF0_0000_0000_0000)
LOG_TWO = 0.6931471805599453
LOWEST = -700.0

SQRT_HALF = np.uint64(0x3FE6_A09E_667F_3BCD)
FROM_SQRT_HALF = np.uint64(0x3FF0_0000_0000_0000 - 0x3FE6_A09E_667F_3BCD)
FRACTION = np.uint64(0x000F_FFFF_FFFF_FFFF)
TWO_TO_52 = np.uint64(0x4330_0000_0000_0000)
S52 = np.uint64(52)
TO_INTEGER = 6755399441055744.0
"""3/2 2^52: added to a smaller number, it leaves the nearest integer in the last bits."""


@inlined
def log(x: float) -> float:
    """The natural logarithm of a positive normal number.

    x = 2^e m with m in [sqrt(1/2), sqrt(2)), and log m = 2 artanh((m - 1)/(m + 1)) as its series to the 15th power
    (error 2e-15). Whatever is added to reals here is small: the kernels' switches allow the compiler to distribute
    and to reorder.
    """
    bits = np.float64(x).view(np.int64)
    shifted = np.int64(bits + (ONE_BITS - SQRT_HALF_BITS))
    exponent = np.float64(np.int32(shifted >> 52)) - 1023.0
    m = np.int64(bits - (shifted & EXPONENT_BITS) + ONE_BITS).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    low = (2.0 + 2.0 / 3.0 * z) + (2.0 / 5.0 + 2.0 / 7.0 * z) * (z * z)
    high = (2.0 / 9.0 + 2.0 / 11.0 * z) + (2.0 / 13.0 + 2.0 / 15.0 * z) * (z * z)
    p = low + high * ((z * z) * (z * z))
    return exponent * LOG_TWO + s * p


@inlined
def exp(y: float) -> float:
    """The exponential e^y for y <= 700; below -700 it stays at e^-700 = 1e-304, a normal number.

    y = k log 2 + r with |r| <= log(2)/2, and e^r as its Taylor series to the 11th power (relative error 3e-14).
    """
    y = y if y > LOWEST else LOWEST
    k = np.floor(y * 1.4426950408889634 + 0.5)
    r = y - k * LOG_TWO
    low = (1.0 + r) + (0.5 + r / 6.0) * (r * r)
    middle = (1.0 / 24.0 + r / 120.0) + (1.0 / 720.0 + r / 5040.0) * (r * r)
    high = (1.0 / 40320.0 + r / 362880.0) + (1.0 / 3628800.0 + r / 39916800.0) * (r * r)
    fourth = (r * r) * (r * r)
    p = low + (middle + high * fourth) * fourth
    power: float = p * np.int64((np.int64(np.int32(k)) + 1023) << 52).view(np.float64)
    return power


@ordered_inlined
def log2(x: float) -> float:
    """The logarithm to the base two of a positive normal number.

    x = 2^e m as in `log`; log2 m as 7 terms in ((m - 1)/(m + 1))², interpolated at Chebyshev's points (error 2e-16).
    """
    shifted = np.uint64(np.float64(x).view(np.uint64) + FROM_SQRT_HALF)
    e = np.uint64((shifted >> S52) | TWO_TO_52).view(np.float64) - (2.0**52 + 1023.0)
    m = np.uint64((shifted & FRACTION) + SQRT_HALF).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    zz = z * z
    low = (2.885390081777927 + 0.9617966939243345 * z) + (0.5770780172463286 + 0.4121984020482752 * z) * zz
    high = (0.32061638813224547 + 0.2614442493522915 * z) + 0.2429160853987535 * zz
    return e + s * (low + high * (zz * zz))


@ordered_inlined
def exp2(y: float) -> float:
    """2 to the power y <= 1000; below -1000 it stays at 2^-1000, so that the result is a normal number.

    y = k + r with k the nearest integer; 2^r as 11 terms, interpolated at Chebyshev's points (relative error 2e-16).
    """
    y = y if y > -1000.0 else -1000.0
    k = y + TO_INTEGER
    r = y - (k - TO_INTEGER)
    rr = r * r
    low = (1.0 + 0.69314718055995 * r) + (0.24022650695910097 + 0.05550410866444772 * r) * rr
    middle = 0.009618129107606888 + 0.0013333558230164974 * r
    middle += (0.0001540353044173605 + 1.5252657260200837e-05 * r) * rr
    high = (1.321544258792169e-06 + 1.0208690299958306e-07 * r) + 7.072585949269223e-09 * rr
    p = low + (middle + high * (rr * rr)) * (rr * rr)
    return np.uint64(np.float64(p).view(np.uint64) + np.uint64(np.float64(k).view(np.uint64) << S52)).view(np.float64)


@inlined
def normal_pair(key: np.uint64, pair: int) -> tuple[float, float]:
    """The `pair`-th pair of standard normals of a key: radius and angle from its uniforms 2*pair and 2*pair + 1.

    The first is that of `base.rng.normals` up to rounding.
    """
    return box_muller(uniform(key, 2 * pair), uniform(key, 2 * pair + 1))


@inlined
def box_muller(u: float, turn: float) -> tuple[float, float]:
    """Two standard normals of two uniforms on [0, 1): sqrt(-2 log(1 - u)) times cosine and sine of 2π `turn`.

    The turn is split into quarters, with Taylor series on [-π/4, π/4].
    """
    radius = np.sqrt(-2.0 * log(1.0 - u))
    quarter = np.floor(4.0 * turn + 0.5)
    a = (turn - 0.25 * quarter) * 6.283185307179586
    z = a * a
    sine = 1.0 / 6227020800.0
    sine = sine * z - 1.0 / 39916800.0
    sine = sine * z + 1.0 / 362880.0
    sine = sine * z - 1.0 / 5040.0
    sine = sine * z + 1.0 / 120.0
    sine = sine * z - 1.0 / 6.0
    sine = a + a * z * sine
    cosine = -1.0 / 87178291200.0
    cosine = cosine * z + 1.0 / 479001600.0
    cosine = cosine * z - 1.0 / 3628800.0
    cosine = cosine * z + 1.0 / 40320.0
    cosine = cosine * z - 1.0 / 720.0
    cosine = cosine * z + 1.0 / 24.0
    cosine = cosine * z - 0.5
    cosine = cosine * z + 1.0
    odd = (quarter == 1.0) | (quarter == 3.0)
    first = sine if odd else cosine
    second = cosine if odd else sine
    first = -first if (quarter == 1.0) | (quarter == 2.0) else first
    second = -second if (quarter == 2.0) | (quarter == 3.0) else second
    return radius * first, radius * second


@inner
def total(row: Floats) -> float:
    """The sum of a row."""
    result = 0.0
    for j in range(row.size):
        result += row[j]
    return result


@inner
def dot(one: Floats, other: Floats) -> float:
    """The sum of the products of two rows."""
    result = 0.0
    for j in range(one.size):
        result += one[j] * other[j]
    return result


@inlined
def close(result: Floats, x: Floats, y: Floats, constant: float, variance: float) -> None:
    """From sums of squares to the log-likelihoods -(square / variance + constant) / 2 at points; -inf where unknown.

    The constant has log 2π for each of the readings.
    """
    for j in range(x.size):
        value = -0.5 * (result[j] / variance + constant)
        known = (value > -np.inf) & (abs(x[j]) < np.inf) & (abs(y[j]) < np.inf)
        result[j] = value if known else -np.inf
