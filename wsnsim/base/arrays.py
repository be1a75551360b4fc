"""Array types used across packages, and what they hold: states, estimates, and readings of one or several components.

States are (D, N): column j is particle j. Readings of several components, and readings that are angles, are brought
into the forms that filters need:

    rows(sensor, readings (n,) or (n, M)) -> (n M,)      a row per component, node by node, as `linearise` has them
    near(sensor, rows, expected) -> rows            angles moved by whole turns to the nearest of what is expected
    means(sensor, readings, groups, count)          one reading for each group of readings, angles on the circle

Times become steps by `first_steps`, and are counted from another origin by `since`.

A sensor model says so by the optional port `VectorReadings`. Without it, a reading is a number without a period.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf, isfinite, nan, tau
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Keys: TypeAlias = NDArray[np.uint64]
Bools: TypeAlias = NDArray[np.bool_]


def planar(points: Floats) -> Floats:
    """Points (n, P) as points (n, 2) in the plane.

    Points with one coordinate lie on the x-axis; of points with three the height is left out.
    """
    if points.shape[-1] == 2:
        return points
    if points.shape[-1] == 3:
        return points[..., :2]
    return np.concatenate([points, np.zeros_like(points)], axis=-1)


def stateful(states: Floats, columns: int) -> Floats:
    """States (D, N) as a contiguous array for kernels. `columns`: number of state columns of the model."""
    assert states.shape[0] == columns, f"states have {states.shape[0]} rows, the model has {columns} state columns"
    return np.ascontiguousarray(states)


def scalars(array: Any) -> Any:
    """A view of a contiguous array whose items are Python numbers: indexing is three times as fast.

    Writing to the view writes to the array.
    """
    return memoryview(array)


class Innovation(NamedTuple):
    """The innovation ν of an update, normalised by its covariance S.

    Attributes:
        nis: the normalised innovation squared νᵀ S⁻¹ ν; NaN without one.
        dof: its degrees of freedom.
    """

    nis: float = float("nan")
    dof: int = 0


NO_INNOVATION = Innovation()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A Gaussian summary of a belief.

    Attributes:
        mean: (D,) of the state, in SI units.
        cov: (D, D) its covariance.
        effective: the effective number of particles; NaN for filters without particles.
        innovation: that of the step's update, for Kalman filters.
    """

    mean: Floats
    cov: Floats
    effective: float = float("nan")
    innovation: Innovation = NO_INNOVATION


Reading: TypeAlias = float | tuple[float, ...]
"""The reading of one node: a number, or a tuple of M numbers if the sensor's readings have M > 1 components."""
CANCELLED: Final = 1e-9
"""A mean of unit vectors that is shorter is rounding error: they cancel."""
SAME_TIME: Final = 1e-6
"""s: times that differ by less are equal (our choice): seconds since 1970 are wrong by up to 0.5 µs once converted."""
LONG_AGO: Final = 1e6
"""s: of greater times, a float holds no ns."""
SCALAR: Final = ("reading",)
"""The components of a reading of a sensor model without the port `VectorReadings`."""


def rounding(dt: float) -> float:
    """s: times that differ by less are equal, and a reading this much later than a step still belongs to it.

    `SAME_TIME`, or a thousandth of a step of `dt` s if that is less.
    """
    return min(SAME_TIME, 1e-3 * dt)


def first_steps(times: Any, dt: float) -> Any:
    """(n,) number of the first step k of `dt` s that is not before each time (n,) in s, but for `rounding(dt)`."""
    return np.ceil((times - rounding(dt)) / dt)


def since(times: Any, origin: Any) -> Any:
    """(n,) s from an origin to each time (n,) in s; rounded to 1 µs for great times, such as seconds since 1970."""
    apart = times - origin
    return np.where(np.maximum(np.abs(times), np.abs(origin)) > LONG_AGO, np.round(apart, 6), apart)[()]


def components_of(sensor: Any) -> tuple[str, ...]:
    """The names of the M components of a reading of this sensor model; ('reading',) if it does not say."""
    return getattr(sensor, "components", SCALAR)


def periods_of(sensor: Any) -> tuple[float, ...]:
    """The period of each component of a reading of this sensor model; 0 for a component that has none."""
    return getattr(sensor, "periods", (0.0,))


def rows(sensor: Any, readings: Floats) -> Floats:
    """The components (n M,) of readings (n,) or (n, M), node by node.

    Args:
        sensor: The sensor model, which says how many components M a reading has.
        readings: (n,), or (n, M) if M > 1.

    Raises:
        ValueError: The readings have another number of components than those of the sensor model.
    """
    count = len(components_of(sensor))
    shape = readings.shape[1:]
    if not readings.size:
        return readings.reshape(0)
    if shape != ((count,) if count > 1 else ()):
        raise ValueError(f"readings of {count} components per node expected, not an array of shape {readings.shape}")
    return readings.reshape(-1)


def is_relative(sensor: Any) -> bool:
    """Whether only the differences between the readings of a step count: see `RelativeReadings`."""
    return getattr(sensor, "relative", False)


def innovation_of(sensor: Any, square: float, used: int) -> Innovation:
    """The innovation of a step of which so many rows were used: one has no degree of freedom if they are relative."""
    dof = used - is_relative(sensor)
    return Innovation(square, dof) if dof > 0 else NO_INNOVATION


def near(sensor: Any, measured: Floats, expected: Floats) -> Floats:
    """Rows moved by whole periods to the nearest of what is expected, so that their difference is the shortest.

    Relative readings are moved by a number that all have in common, so that the mean of their differences is 0. Other
    rows without a period are returned as they are. Half a period away from what is expected, either side may be meant.

    Args:
        sensor: The sensor model.
        measured: (n M, ...) what was measured, as `rows` gives it.
        expected: (n M, ...) what was expected, of a shape to which this one broadcasts: for `rows` (n M,) and the
            expected rows (n M, N) at N points, pass `rows[:, None]`.
    """
    if is_relative(sensor) and len(measured):
        apart: Floats = measured - expected
        moved: Floats = measured - apart.mean(axis=0)
        return moved
    periods = periods_of(sensor)
    if not any(periods):
        return measured
    lengths, divisors = _per_row(periods, len(measured) // len(periods))
    if measured.ndim > 1:
        lengths, divisors = (each.reshape(-1, *[1] * (measured.ndim - 1)) for each in (lengths, divisors))
    return measured - lengths * np.round((measured - expected) / divisors)


def means(sensor: Any, readings: Floats, groups: Ints, count: int) -> Floats:
    """Means (count,) or (count, M) of readings (n,) or (n, M) that belong to groups (n,); NaN where a group has none.

    The mean of angles is the direction of the sum of their unit vectors (Mardia, Jupp 2000, section 2.2.1), in the turn
    nearest to the first of them. Where the sum is zero, there is no mean direction, and the first one stands.
    """
    columns = readings.reshape(len(readings), -1).T
    periods = periods_of(sensor)[: len(columns)]
    each = [_mean(values, groups, count, period) for values, period in zip(columns, periods, strict=True)]
    return each[0] if readings.ndim == 1 else np.column_stack(each)


def _mean(values: Floats, groups: Ints, count: int, period: float) -> Floats:
    sizes, first = np.bincount(groups, minlength=count), np.full(count, nan)
    first[groups[::-1]] = values[::-1]  # of equal indices, the first value stays
    if not period:
        sums = np.bincount(groups, values, count)
        np.divide(sums, sizes, out=first, where=sizes > 0)
        return first
    across, up = (np.bincount(groups, part(values * tau / period), count) for part in (np.cos, np.sin))
    turned = np.arctan2(up, across) * period / tau - first
    known = (sizes > 1) & (np.hypot(across, up) > CANCELLED * sizes)
    return np.where(known, first + turned - period * np.round(turned / period), first)


@lru_cache
def _per_row(periods: tuple[float, ...], nodes: int) -> tuple[Floats, Floats]:
    """The period of each row, and what to divide by for a number of periods: infinity where there is none."""
    lengths = np.tile(np.array(periods, dtype=np.float64), nodes)
    divisors = np.where(lengths > 0.0, lengths, inf)
    lengths.flags.writeable = divisors.flags.writeable = False
    return lengths, divisors


def as_readings(readings: Floats) -> list[Reading]:
    """The readings of nodes, from an array (n,) or (n, M)."""
    values: list[Any] = readings.tolist()
    return values if readings.ndim == 1 else [tuple(each) for each in values]


def missing(sensor: Any) -> Reading:
    """The reading of a node that has none, for arrays: not a number, in each component."""
    count = len(components_of(sensor))
    return nan if count == 1 else (nan,) * count


def finite(sensor: Any, readings: Floats) -> Bools:
    """Which readings are finite in all components, (...,) of an array (...,) or (..., M) of this sensor's readings."""
    each = np.isfinite(readings)
    return each if len(components_of(sensor)) == 1 else np.all(each, axis=-1)


def is_finite(reading: Reading) -> bool:
    """Whether every component of a reading is finite."""
    return all(map(isfinite, reading)) if isinstance(reading, tuple) else isfinite(reading)
