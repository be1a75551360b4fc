"""The least-squares line through a short series, for extrapolation.

    line_at(time, times, x) -> float

Plain Python: for five numbers, compiling does not pay.
"""

from __future__ import annotations

from collections.abc import Sequence


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
