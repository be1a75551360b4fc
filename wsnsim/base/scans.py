"""Scans of detections that name no target, and what trackers of several targets make of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel, SensorModel


@dataclass(frozen=True, slots=True)
class Scan:
    """The detections of one node at a step; their order means nothing."""

    node: int
    time: float
    detections: Floats
    bits: int = 0


class Facts(NamedTuple):
    """What a head assumes of motion, sensor and scans."""

    motion: MotionModel
    sensor: SensorModel
    dt: float
    probability: float
    clutter: float
    volume: float


class TrackEstimate(NamedTuple):
    """The estimate of one track."""

    number: int
    mean: Floats
    cov: Floats
    existence: float
    confirmed: bool
    since: float


class TrackEvent(NamedTuple):
    """What happened to a track."""

    kind: str
    track: int
    other: int = -1


class Outcome(NamedTuple):
    """What a step gave."""

    belief: Any
    events: tuple[TrackEvent, ...]
    explained: tuple[Floats, ...]
    cycles: float
