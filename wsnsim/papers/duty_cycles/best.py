"""The best wake interval of a tracker on a kind of MAC, as docs/duty_cycles.md defines it.

best(data, tracker, kind) -> Best

Of the usable intervals the best one spends least. An interval is usable if its share of steps in time is near that of
the same tracker on CSMA, and its error near the least of this tracker on this kind of MAC and on CSMA.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.papers.answers import TAIL, UNKNOWN, Interval
from wsnsim.papers.duty_cycles.points import REFERENCE, intervals, statistic
from wsnsim.papers.measures import Data

ENERGY: Final = "mean:energy"
ERROR: Final = "median:error"
IN_TIME: Final = "mean:tracked"


class Best(NamedTuple):
    """The best interval of a tracker on a kind of MAC.

    Attributes:
        interval: in s, with the range of those that resamples choose; NaN if the runs as they are have none.
        energies: (1 + draws,) J at the best interval of the runs as they are, and of every resample; NaN without one.
        without: the share of the resamples in which no interval is usable; ranges and intervals are over the others.
        usable: the usable intervals of the runs as they are, in s.
    """

    tracker: str
    interval: Interval
    energies: Floats
    without: float
    usable: tuple[float, ...]


def best(data: Data, tracker: str, kind: str) -> Best:
    """The best interval of a tracker on a kind of MAC; it needs that tracker on CSMA."""
    found = intervals(data, tracker, kind)
    seconds, fit = np.array([*found]), usable(data, tracker, [*found.values()])
    energies = np.where(fit, [statistic(data, variant, ENERGY) for variant in found.values()], np.inf)
    chosen = np.argmin(energies, axis=0)
    least = energies[chosen, np.arange(energies.shape[1])]
    least = np.where(np.isfinite(least), least, np.nan)
    picked = np.where(np.isfinite(least), seconds[chosen], np.nan)
    without = float(np.isnan(least[1:]).mean())
    return Best(tracker, _range(picked), least, without, tuple(seconds[fit[:, 0]].tolist()))


def usable(data: Data, tracker: str, variants: list[str]) -> Bools:
    """(n, 1 + draws) which variants of a tracker are usable, in the runs as they are and in every resample."""
    wanted, reference = data.published["registered"]["usable"], f"{tracker}, {REFERENCE}"
    in_time = np.array([statistic(data, variant, IN_TIME) for variant in variants])
    errors = np.array([statistic(data, variant, ERROR) for variant in [*variants, reference]])
    least = np.fmin.reduce(errors, axis=0)  # NaN where all are
    fit: Bools = (errors[:-1] <= wanted["error"] * least) & (
        in_time >= wanted["in_time"] * statistic(data, reference, IN_TIME)
    )
    return fit


def over_known(values: Floats) -> Interval:
    """The interval of a value (1 + draws,) over the resamples that have one."""
    known = values[1:][np.isfinite(values[1:])]
    if not np.isfinite(values[0]) or not known.size:
        return UNKNOWN
    return Interval(float(values[0]), *(float(end) for end in np.quantile(known, [TAIL, 1.0 - TAIL])))


def _range(picked: Floats) -> Interval:
    """The interval that the runs choose, with the central 95 % of those that resamples choose."""
    known = picked[1:][np.isfinite(picked[1:])]
    if not np.isfinite(picked[0]) or not known.size:
        return UNKNOWN
    low, high = np.quantile(known, [TAIL, 1.0 - TAIL], method="inverted_cdf")
    return Interval(float(picked[0]), float(low), float(high))
