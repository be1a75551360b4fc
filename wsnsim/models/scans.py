"""Detections that name no target: what makes a node's scan, beside its sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

from wsnsim.base.arrays import Floats, Keys, components_of
from wsnsim.base.detections import Interval, space_of, why_no_detections
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.bounds import READING, SHARE

CLUTTER = Quantity("", ge=0.0, le=1000.0)
RESOLUTION = Quantity("", ge=0.0, le=1e9, label="as readings")
PROTOCOLS = ("open", "standing")
"""The head protocols that lead groups of tracks."""


@part
class UnlabelledDetection:
    """Scans instead of readings that name their target: detections without an order, misses and false detections.

    Each awake node scans at each step. It detects a target within range with the probability `probability`, and a
    Poisson number of false detections, uniform over the sensor's space: a turn of a bearing, the sensing range of a
    range, or the `window`. Two targets whose readings without noise differ by less than `resolution` in every component
    give one detection, the mean of both. A detection, also a false one, wakes a dormant node as a target does. Each
    takes a packet when the scan is sent, as a reading does.

    Recorded readings are taken as detected, of the target that the file says: only false detections are added to them,
    and `probability` is what heads assume.

    Source: the measurement model of Bar-Shalom, Li (1995): at most one detection of a target, and Poisson clutter.
    """

    false_alarm: ClassVar[float] = 0.0

    probability: Annotated[float, SHARE, "P_D: probability that a target within range is detected"] = 0.9
    clutter: Annotated[float, CLUTTER, "expected number of false detections in a scan"] = 0.0
    resolution: Annotated[
        tuple[float, ...],
        RESOLUTION,
        "by component of a reading, the difference below which two targets give one detection; none: all are resolved",
    ] = ()
    window: Annotated[
        tuple[Interval, ...],
        READING,
        "by component of a reading, the interval [least, greatest] of false detections; none: the sensor's space",
    ] = ()

    @property
    def missed(self) -> float:
        """The probability that a target within range is not detected."""
        return 1.0 - self.probability

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings, unchanged."""
        return readings

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a sensor that makes no detections, for a space of clutter, and for others' options."""
        sensor = setup.sensor
        reason = why_no_detections(sensor)
        if reason:
            yield Issue(("sensor", "kind"), reason)
        else:
            yield from self._bad_lengths(sensor)
            yield from self._bad_space(sensor)
        if not isinstance(setup, NetworkSetup):
            yield Issue(("detection", "kind"), "scans are gathered by heads: unlabelled readings need a network")
        elif setup.until_clusters is not None:
            yield Issue(("until",), "groups begin and end: no number of clusters ends a run of unlabelled readings")
        elif setup.head_protocol not in PROTOCOLS:
            yield Issue(
                ("clusters", "kind"),
                "no group of tracks is led so: for unlabelled readings use central, or strongest_signal with "
                "successor_rule: nearest",
            )
        elif setup.wakeup.mechanism != "none":
            yield Issue(("wakeup", "kind"), "nodes are not woken ahead of tracks of unlabelled readings: use none")

    def _bad_lengths(self, sensor: object) -> Iterator[Issue]:
        names = components_of(sensor)
        for key, given in (("resolution", self.resolution), ("window", self.window)):
            if given and len(given) != len(names):
                yield Issue(
                    ("detection", key), f"expected a value per component ({', '.join(names)}), got {len(given)}"
                )

    def _bad_space(self, sensor: object) -> Iterator[Issue]:
        for low, high in self.window:
            if not low < high:
                yield Issue(
                    ("detection", "window"), f"[{low:g}, {high:g}] is empty: the least must be below the greatest"
                )
        if self.clutter and space_of(sensor, self.window) is None:
            names = ", ".join(components_of(sensor))
            message = (
                f"readings of this sensor ({names}) have no bounds: give detection.window, the interval of clutter"
            )
            yield Issue(("detection", "clutter"), message)
