"""Extrapolation of a short series: the grey model GM(1,1), an exponential fit of its cumulative sums, and a line.

    forecast_at(time, times, x, shift, correction) -> float      of values at unequal times
    line_at(time, times, x) -> float, the least-squares line

x1_i = Σ_{j<=i} x_j satisfies dx1/dt + a x1 = u in the mean; the restored model is
x̂_{i+1} = (1 - e^a)(x_1 - u/a) e^{-a i}.

Plain Python: for five numbers, compiling does not pay (5 us per fit against 1 us, and seconds to compile). Results are
finite if the series is.

Source: Deng (2002); Li, Jiang, Zhang, Zhang (2012), section 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, TypeAlias

Correction: TypeAlias = Literal["none", "tail", "literal"]

FLAT: Final = 1e-9
"""|a| below which the model is a constant, its limit."""
SINGULAR: Final = 1e-14
"""Relative determinant of the least squares below which there is no fit."""
LARGEST_EXPONENT: Final = 700.0
SMALL_ERROR: Final = 0.6745
WORST_RATIO: Final = 0.35
LEAST_SHARE: Final = 0.95
MARGIN: Final = 1e-6


def gm11(values: Sequence[float]) -> tuple[float, float]:
    """(a, u), the least squares of x_i = -a z_i + u over i = 2..n, with z_i = (x1_{i-1} + x1_i) / 2.

    In closed form, with m = n - 1. Without a fit (D = 0, as for two points, or zeros) it is (0, the last value).
    """
    m, total = len(values) - 1, values[0]
    sz = szz = sx = szx = 0.0
    for value in values[1:]:
        z = total + 0.5 * value
        total += value
        sz, szz, sx, szx = sz + z, szz + z * z, sx + value, szx + z * value
    determinant = m * szz - sz * sz  # D
    if not abs(determinant) > SINGULAR * m * szz:
        return 0.0, values[-1]
    a, u = (sz * sx - m * szx) / determinant, (szz * sx - sz * szx) / determinant
    return (a, u) if math.isfinite(a) and math.isfinite(u) else (0.0, values[-1])


def forecast(given: Sequence[float], ahead: float, shift: float, correction: Correction) -> float:
    """The restored model at `ahead` intervals beyond the last of n values, at the index h = n - 1 + ahead, corrected.

    `shift` is added before and subtracted after: the model is not invariant to it, and diverges on mixed signs. If the
    result is not finite, it is the last value. Where the check fails, a model of the residuals corrects it. `literal`:
    GM(1,1) of all residuals, of which the first is 0 and the signs are mixed: as good as none. `tail`, our repair: of
    the residuals 2..n, shifted until they are positive.
    """
    index = len(given) - 1 + ahead
    values = [value + shift for value in given]
    a, u = gm11(values)
    result = restored(values[0], a, u, index)
    if correction != "none":
        residuals = residuals_of(values, a, u)
        ratio, share = check(values, residuals)
        if ratio > WORST_RATIO or share < LEAST_SHARE:
            result += _residual(residuals, index, correction)
    return result - shift if math.isfinite(result - shift) else given[-1]


def forecast_at(time: float, times: Sequence[float], x: Sequence[float], shift: float, correction: Correction) -> float:
    """The forecast for a time, from values at unequal times that increase: Ψ, then the index h = (time - t_1) / Δ."""
    spacing = (times[-1] - times[0]) / (len(times) - 1)
    return forecast(equal_intervals(times, x), (time - times[-1]) / spacing, shift, correction)


def equal_intervals(times: Sequence[float], x: Sequence[float]) -> list[float]:
    """Ψ: x at n equally spaced times from the first to the last, linear in between."""
    spacing = (times[-1] - times[0]) / (len(times) - 1)  # Δ
    found, j = [float(x[0])], 0
    for i in range(1, len(times) - 1):
        k = times[0] + i * spacing
        while times[j + 1] < k:
            j += 1
        found.append(x[j] + (x[j + 1] - x[j]) * ((k - times[j]) / (times[j + 1] - times[j])))
    return [*found, float(x[-1])]


def restored(first: float, a: float, u: float, index: float) -> float:
    """x̂ at an index i, a whole one or not: (1 - e^a)(x_1 - u/a) e^{-a i}; u, its limit, where a is 0; x_1 at 0."""
    if index == 0.0:
        return first
    if abs(a) < FLAT:
        return u
    return -math.expm1(min(a, LARGEST_EXPONENT)) * (first - u / a) * math.exp(_bounded(-a * index))


def check(values: Sequence[float], residuals: Sequence[float]) -> tuple[float, float]:
    """(C, p): deviation of the residuals over that of the series; share of them within 0.6745 S1 of their mean.

    A constant series: C = 0 where the residuals are constant, too, else infinite. A forecast is corrected unless
    C <= 0.35 and p >= 0.95: no gate of quality, it passes biased extrapolations, and fails constants.
    """
    _, spread = _moments(values)
    middle, off = _moments(residuals)
    limit = SMALL_ERROR * spread
    share = sum([abs(q - middle) < limit for q in residuals]) / len(values)
    return (off / spread if spread > 0 else 0.0 if off == 0 else math.inf), share


def residuals_of(values: Sequence[float], a: float, u: float) -> list[float]:
    """q: what the restored model leaves of each value; 0 of the first."""
    if abs(a) < FLAT:
        return [0.0, *[value - u for value in values[1:]]]
    scale = -math.expm1(min(a, LARGEST_EXPONENT)) * (values[0] - u / a)
    return [0.0, *[value - scale * math.exp(_bounded(-a * i)) for i, value in enumerate(values[1:], 1)]]


def _residual(residuals: list[float], index: float, correction: Correction) -> float:
    """What a model of the residuals adds at an index; 0 where it leaves the numbers."""
    if not all(map(math.isfinite, residuals)):
        return 0.0
    if correction == "literal":
        added = restored(0.0, *gm11(residuals), index)
    else:
        tail = residuals[1:]
        if len(tail) < 2:
            return 0.0
        c = max(0.0, -min(tail)) + max(tail) - min(tail) + MARGIN
        moved = [q + c for q in tail]
        added = restored(moved[0], *gm11(moved), index - 1.0) - c
    return added if math.isfinite(added) else 0.0


def _moments(values: Sequence[float]) -> tuple[float, float]:
    """Mean and population standard deviation."""
    middle = sum(values) / len(values)
    return middle, math.sqrt(sum([(value - middle) * (value - middle) for value in values]) / len(values))


def _bounded(exponent: float) -> float:
    """The exponent, within what e to its power can be a number of."""
    return max(-LARGEST_EXPONENT, min(exponent, LARGEST_EXPONENT))


def line_at(time: float, times: Sequence[float], x: Sequence[float]) -> float:
    """The value at a time of the least-squares line through the values x at `times`, which need not be equally spaced.

    If all values are of one time, it is their mean. With n equal intervals Δ and errors of standard deviation s, the
    variance at h Δ from the middle of the times is s² (1/n + 12 h² / (n (n² - 1))).
    """
    n = len(times)
    middle, mean = sum(times) / n, sum(x) / n
    offsets = [each - middle for each in times]
    squares = sum([offset * offset for offset in offsets])
    if squares == 0.0:
        return mean
    slope = sum([offset * (value - mean) for offset, value in zip(offsets, x, strict=True)]) / squares
    return mean + slope * (time - middle)
