"""The grey model GM(1,1): a short series, summed up, fitted by an exponential, and what it says beyond its end.

    gm11(x) -> (a, u)      predict(x, ahead=1.0, shift=0.0) -> float      equal_intervals(t, x) -> (k, x at k)

x1_i = Σ_{j<=i} x_j satisfies dx1/dt + a x1 = u in the mean; the restored model is
x̂_{i+1} = (1 - e^a)(x_1 - u/a) e^{-a i}.

Plain Python: five numbers are too few to be worth compiling. Every result is finite where the series is.

Source: Deng (2002); Li, Jiang, Zhang, Zhang (2012), section 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Series: TypeAlias = Floats | Sequence[float]
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


def gm11(x: Series) -> tuple[float, float]:
    """(a, u), the least squares of x_i = -a z_i + u over i = 2..n, with z_i = (x1_{i-1} + x1_i) / 2.

    Where there is no fit (D = 0, as of two points, or of zeros): (0, the last value). Raises ValueError for fewer than
    two values, and for one that is not finite.
    """
    values = _series(x)
    m, total = len(values) - 1, values[0]
    sz = szz = sx = szx = 0.0
    for value in values[1:]:
        z = total + 0.5 * value
        total += value
        sz, szz, sx, szx = sz + z, szz + z * z, sx + value, szx + z * value
    determinant = m * szz - sz * sz
    if not abs(determinant) > SINGULAR * m * szz:
        return 0.0, values[-1]
    return (sz * sx - m * szx) / determinant, (szz * sx - sz * szx) / determinant


def predict(x: Series, ahead: float = 1.0, shift: float = 0.0) -> float:
    """The restored model at `ahead` intervals beyond the last of n values: at the index h = n - 1 + ahead.

    `shift` is added before and subtracted after: the model is not invariant to it, and bears no mixed signs. Where the
    model leaves the numbers, the last value. Raises ValueError as `gm11` does.
    """
    return forecast(x, ahead, shift, "none")


def forecast(x: Series, ahead: float = 1.0, shift: float = 0.0, correction: Correction = "tail") -> float:
    """The same, corrected by a model of the residuals where the check fails.

    `literal`: GM(1,1) of all residuals, of which the first is 0 and the signs are mixed: as good as none. `tail`, our
    repair: of the residuals 2..n, shifted until they are positive.
    """
    values = [value + shift for value in _series(x)]
    a, u = gm11(values)
    index = len(values) - 1 + ahead
    result = restored(values[0], a, u, index)
    if correction != "none" and not passes(values, a, u):
        result += _residual(values, a, u, index, ahead, correction)
    return result - shift if math.isfinite(result) else values[-1] - shift


def equal_intervals(t: Series, x: Series) -> tuple[Floats, Floats]:
    """Ψ: the series at n equally spaced times from the first to the last, by linear interpolation; (k, x at k), (n,).

    Raises ValueError for fewer than two times, and for times that do not increase.
    """
    times, values = np.asarray(t, dtype=np.float64), np.asarray(x, dtype=np.float64)
    if times.ndim != 1 or times.shape != values.shape or times.size < 2:
        raise ValueError(f"as many values as times are needed, two at least, got {values.shape} and {times.shape}")
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise ValueError("times must increase, and all be finite, as the values must")
    equal = np.linspace(times[0], times[-1], times.size)
    return equal, np.interp(equal, times, values)


def restored(first: float, a: float, u: float, index: float) -> float:
    """x̂ at an index (a whole one or not) after the first: (1 - e^a)(x_1 - u/a) e^{-a i}; u, its limit, where a is 0."""
    if abs(a) < FLAT:
        return u
    return -math.expm1(min(a, LARGEST_EXPONENT)) * (first - u / a) * math.exp(_bounded(-a * index))


def check(x: Series, a: float, u: float) -> tuple[float, float]:
    """(C, p): deviation of the residuals over that of the series; share of them within 0.6745 S1 of their mean.

    A constant series: C = 0 where the residuals are constant, too, else infinite.
    """
    values = _series(x)
    residuals = [0.0, *(value - restored(values[0], a, u, i) for i, value in enumerate(values) if i)]
    _, spread = _moments(values)
    middle, off = _moments(residuals)
    share = sum(abs(q - middle) < SMALL_ERROR * spread for q in residuals) / len(values)
    return (off / spread if spread > 0 else 0.0 if off == 0 else math.inf), share


def passes(x: Series, a: float, u: float) -> bool:
    """Whether C <= 0.35 and p >= 0.95. No gate of quality: it passes biased extrapolations, and fails constants."""
    ratio, share = check(x, a, u)
    return ratio <= WORST_RATIO and share >= LEAST_SHARE


def _residual(values: list[float], a: float, u: float, index: float, ahead: float, correction: Correction) -> float:
    """What a model of the residuals adds; 0 where it leaves the numbers."""
    residuals = [0.0, *(value - restored(values[0], a, u, i) for i, value in enumerate(values) if i)]
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
        added = restored(moved[0], *gm11(moved), len(moved) - 1 + ahead) - c
    return added if math.isfinite(added) else 0.0


def _series(x: Series) -> list[float]:
    values = [float(value) for value in x]
    if len(values) < 2 or not all(map(math.isfinite, values)):
        raise ValueError(f"a grey model needs two or more finite values, got {values[:8]}")
    return values


def _moments(values: list[float]) -> tuple[float, float]:
    """Mean and population standard deviation."""
    middle = sum(values) / len(values)
    return middle, math.sqrt(sum((value - middle) * (value - middle) for value in values) / len(values))


def _bounded(exponent: float) -> float:
    return max(-LARGEST_EXPONENT, min(exponent, LARGEST_EXPONENT))
