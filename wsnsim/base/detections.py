"""Detections that name no target: what they may be of, and the ports of multi-target trackers.

A multi-target tracker is pure: it neither sends nor knows the clock, and its beliefs are values. The network gathers
scans, has the head compute, and sends beliefs.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, ClassVar, Final, Protocol, runtime_checkable

from wsnsim.base.arrays import Estimate, is_relative, periods_of
from wsnsim.base.ports import KnownNodes
from wsnsim.base.scans import Facts, Scan, ScanOutcome, TrackEstimate

CLUTTER: Final = -1
"""The origin of a false detection."""
Interval = tuple[float, float]


@runtime_checkable
class ReportsScans(Protocol):
    """Optional port of a detection: nodes report scans instead of readings that name their target."""

    @property
    def probability(self) -> float:
        """The probability that a target within range is detected."""

    @property
    def clutter(self) -> float:
        """The expected number of false detections in a scan."""

    @property
    def resolution(self) -> tuple[float, ...]:
        """By component, the difference below which two targets give one detection; empty: all are resolved."""

    @property
    def window(self) -> tuple[Interval, ...]:
        """By component, the interval of false detections; empty: the sensor's space."""


def space_of(sensor: Any, window: tuple[Interval, ...] = ()) -> tuple[Interval, ...] | None:
    """The interval of each component of a reading in which false detections are; None if it is unbounded.

    It is the window if one is given, what the sensor model says (`reading_space`), or a period of each angle.
    """
    if window:
        return window
    told: tuple[Interval, ...] = getattr(sensor, "reading_space", ())
    if not told:
        told = tuple((-period / 2, period / 2) if period else (0.0, math.inf) for period in periods_of(sensor))
    return told if all(math.isfinite(low + high) for low, high in told) else None


def why_no_detections(sensor: Any) -> str:
    """Why the readings of a sensor model are no detections of single targets; '' if they are."""
    if getattr(sensor, "additive", False) or getattr(getattr(sensor, "law", None), "additive", False):
        return "a reading adds up what comes from all targets: it is no detection of one; take a range or a bearing"
    if hasattr(sensor, "reading_values"):
        return "a reading that names a cell is no detection that a track could be near"
    if is_relative(sensor):
        return "only differences of the readings of one target count: without names none is known"
    return ""


def volume_of(sensor: Any, window: tuple[Interval, ...] = ()) -> float:
    """The volume of the space of a reading; infinite where it is unbounded."""
    space = space_of(sensor, window)
    return math.inf if space is None else math.prod(high - low for low, high in space)


class Management(Protocol):
    """How tracks begin, are confirmed and are deleted.

    `known_start`: tracks begin from the priors of targets; `starts`: tracks begin from detections. `rate_sd` is the
    deviation of the speed of targets that may begin, in m/s.
    """

    known_start: ClassVar[bool]
    starts: ClassVar[bool]

    @property
    def rate_sd(self) -> float: ...


class MultiTracker(Protocol):
    """A multi-target tracker: association, a filter for each track, and the management of tracks.

    A class of this port says `multi_target: ClassVar[bool] = True`.
    """

    @property
    def filter(self) -> Any:
        """The single-target filter of each track."""

    @property
    def management(self) -> Any:
        """The management of tracks."""

    def begin(self, priors: Sequence[Estimate], time: float, facts: Facts, number: int = 0) -> Any:
        """The first belief: a confirmed track per prior, with the numbers `number`, `number` + 1, ..."""

    def step(
        self, belief: Any, time: float, scans: Sequence[Scan], nodes: KnownNodes, facts: Facts, number: int
    ) -> ScanOutcome:
        """Predict to a time, and update with the scans of a step. New tracks have the numbers from `number` on.

        Args:
            belief: That of an earlier step, or of this one.
            time: Of the step, in s.
            scans: By ascending node; one without detections says that the node surely scanned and found nothing.
            nodes: The nodes of the scans.
            facts: What the head assumes.
            number: The first number of tracks that begin in this step.
        """

    def estimates(self, belief: Any, facts: Facts) -> Sequence[TrackEstimate]:
        """The tracks, tentative ones too, by ascending number."""

    def numbers_of(self, belief: Any) -> int:
        """How many numbers a belief is when it is sent, of which a packet holds four."""

    def only(self, belief: Any, numbers: Collection[int]) -> Any:
        """The belief about some of its tracks alone."""

    def joined(self, beliefs: Sequence[Any]) -> Any:
        """A belief with the tracks of several of the same time."""
