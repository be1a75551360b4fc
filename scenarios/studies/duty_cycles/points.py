"""The points of the comparison: a tracker on a MAC, and statistics over the runs that all points have.

    trackers(data), macs(data)                       those that have been run, in their order
    statistic(data, variant, measure) -> (1 + draws,) of the runs as they are, and of every resample
    intervals(data, tracker, kind) -> {s: variant}   the wake intervals, or slotframes, of a kind of MAC

All points are resampled together: they have the same ground truths, nodes and readings.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.papers.toolkit import TAIL, UNKNOWN, Bools, Data, Floats, Interval, Ints, interval, resamples, sample

REFERENCE: Final = "csma"
"""The MAC that listens always."""
UNITS: Final = {"xmac": 1e-3, "contikimac": 1e-3, "tsch": 10e-3, "tsch, shared 4": 10e-3}
"""Kinds of duty-cycled MACs, and the seconds of the number in their names: ms of an interval, slots of a slotframe."""


def tracker_of(variant: str) -> str:
    """'gmtt, xmac 500, near 125' -> 'gmtt'."""
    return variant.partition(", ")[0]


def mac_of(variant: str) -> str:
    """'gmtt, xmac 500, near 125' -> 'xmac 500, near 125'."""
    return variant.partition(", ")[2]


@functools.lru_cache(maxsize=16)
def run(data: Data) -> tuple[str, ...]:
    """The variants that have runs, in their order."""
    return tuple(variant for variant in data.variants if len(data.of(variant, "runs")))


def trackers(data: Data) -> list[str]:
    """The trackers that have been run."""
    return [*dict.fromkeys(map(tracker_of, run(data)))]


def macs(data: Data) -> list[str]:
    """The MACs that have been run, with their intervals."""
    return [*dict.fromkeys(map(mac_of, run(data)))]


@functools.lru_cache(maxsize=16)
def common_runs(data: Data) -> Ints:
    """The numbers of the runs that all variants have which have any."""
    numbers = [data.of(variant, "runs")["replicate"].to_numpy() for variant in run(data)]
    return functools.reduce(np.intersect1d, numbers)


@functools.lru_cache(maxsize=4096)
def statistic(data: Data, variant: str, measure: str) -> Floats:
    """(1 + draws,) a measure of a variant, over the runs that all variants have."""
    return resamples(sample(data, variant, measure).among(common_runs(data)))


def ratio(data: Data, one: str, other: str, measure: str) -> Floats:
    """(1 + draws,) the measure of a variant over that of another."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Floats = statistic(data, one, measure) / statistic(data, other, measure)
    return found


def value(data: Data, variant: str, measure: str) -> Interval:
    """The measure of a variant with its interval."""
    return interval(statistic(data, variant, measure))


def intervals(data: Data, tracker: str, kind: str) -> dict[float, str]:
    """{wake interval or slotframe in s: variant} of a tracker on a kind of MAC, ascending."""
    found = {}
    for variant in run(data):
        name, number = _kind_and_number(mac_of(variant))
        if tracker_of(variant) == tracker and name == kind:
            found[float(number) * UNITS[kind]] = variant
    return dict(sorted(found.items()))


def kinds(data: Data) -> list[str]:
    """The kinds of duty-cycled MACs that have been run."""
    found = {_kind_and_number(mac)[0] for mac in macs(data)}
    return [kind for kind in UNITS if kind in found]


def _kind_and_number(mac: str) -> tuple[str, str]:
    """'tsch 31, shared 4' -> ('tsch, shared 4', '31'); the number of 'csma' is empty."""
    name, comma, other = mac.partition(", ")
    kind, _, number = name.partition(" ")
    return f"{kind}{comma}{other}", number


ENERGY: Final = "mean:energy"
ERROR: Final = "median:error"
IN_TIME: Final = "mean:tracked"
DELIVERED: Final = "mean:delivered"


Rule: TypeAlias = Callable[[Data, str, list[str]], Bools]
"""(n, 1 + draws) which of a tracker's variants are usable, in the runs as they are and in every resample."""


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


def best(data: Data, tracker: str, kind: str, rule: Rule | None = None) -> Best:
    """The best interval of a tracker on a kind of MAC; it needs that tracker on CSMA.

    `rule` says which are usable: `usable_beside_csma` if None.
    """
    found = intervals(data, tracker, kind)
    seconds, fit = np.array([*found]), (rule or usable_beside_csma)(data, tracker, [*found.values()])
    energies = np.where(fit, [statistic(data, variant, ENERGY) for variant in found.values()], np.inf)
    chosen = np.argmin(energies, axis=0)
    least = energies[chosen, np.arange(energies.shape[1])]
    least = np.where(np.isfinite(least), least, np.nan)
    picked = np.where(np.isfinite(least), seconds[chosen], np.nan)
    without = float(np.isnan(least[1:]).mean())
    return Best(tracker, _range(picked), least, without, tuple(seconds[fit[:, 0]].tolist()))


def usable_beside_csma(data: Data, tracker: str, variants: list[str]) -> Bools:
    """(n, 1 + draws) which are in time, near the error, and deliver about as much as the tracker on CSMA."""
    wanted, reference = data.registered["later"]["usable"], f"{tracker}, {REFERENCE}"
    in_time, delivered, errors = (
        np.array([ratio(data, variant, reference, measure) for variant in variants])
        for measure in (IN_TIME, DELIVERED, ERROR)
    )
    fit: Bools = (in_time >= wanted["in_time"]) & (delivered >= wanted["delivered"]) & (errors <= wanted["error"])
    return fit


def usable_as_first_registered(data: Data, tracker: str, variants: list[str]) -> Bools:
    """(n, 1 + draws) which are in time, and near the least error of the tracker; for the hypotheses on them."""
    wanted, reference = data.registered["usable"], f"{tracker}, {REFERENCE}"
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
