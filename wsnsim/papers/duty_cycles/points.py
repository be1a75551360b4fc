"""The points of the comparison: a tracker on a MAC, and statistics over the runs that all points have.

    trackers(data), macs(data)                       those that have been run, in their order
    statistic(data, variant, measure) -> (1 + draws,) of the runs as they are, and of every resample
    intervals(data, tracker, kind) -> {s: variant}   the wake intervals, or slotframes, of a kind of MAC

All points are resampled together: they have the same ground truths, nodes and readings.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.papers.answers import Interval, interval, resamples
from wsnsim.papers.measures import Data, sample

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
