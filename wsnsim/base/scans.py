"""Scans: what a node detects at an instant, without names, and what a head assumes of how detections arise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel, SensorModel

EventKind = Literal["start", "confirm", "delete", "merge"]


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """The detections of one node at one instant. Their order means nothing.

    Attributes:
        node: its id.
        time: the instant in s.
        detections: (M, d) readings of d components; M is 0 if nothing was detected.
        bits: the size of the scan on the air.
        heard: the probability that a detection that the node made is in the scan: below 1 where the radio loses some.
    """

    node: int
    time: float
    detections: Floats
    bits: int = 0
    heard: float = 1.0


class Facts(NamedTuple):
    """What a head assumes of targets and of scans.

    Attributes:
        motion: the motion model of each target.
        sensor: the sensor model of each node.
        dt: the length of a step in s.
        probability: that of the detection of a target that a node can sense, in (0, 1].
        clutter: the expected number of false detections in a scan.
        volume: the size of the space of readings in which they are uniform, in the product of the components' units.
    """

    motion: MotionModel
    sensor: SensorModel
    dt: float
    probability: float
    clutter: float
    volume: float


class TrackEvent(NamedTuple):
    """What happened to a track; of a merged one, `other` is the one that stays."""

    kind: EventKind
    track: int
    other: int = -1


class TrackEstimate(NamedTuple):
    """The estimate of a track: mean (D,) and covariance (D, D) of the state of the scenario's motion.

    Attributes:
        number: of the track, unique in a run.
        existence: the probability that its target exists; NaN if the tracker does not estimate it.
        confirmed: whether it counts as a target; others are tentative.
        since: when it started, in s.
    """

    number: int
    mean: Floats
    cov: Floats
    existence: float
    confirmed: bool
    since: float


class ScanOutcome(NamedTuple):
    """What a step gives.

    Attributes:
        belief: that after the step.
        events: what happened to tracks.
        explained: of each scan (M,) the probability that a detection came from a track, in the order given.
        cycles: the operations of the step.
    """

    belief: Any
    events: tuple[TrackEvent, ...]
    explained: tuple[Floats, ...]
    cycles: float
