"""Hints that particles or packets, and not the filter, decided a comparison.

traffic(folder, table) -> [PointTraffic of each row]        hint(here, there, names) -> a sentence, or ''

A network takes part in the decision if packets take time and estimates come late or not at all: the messages of a step,
above all of a handover with all its particles, take longer than the step. Different filters with different numbers of
particles differ by these, too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns
from wsnsim.base.errors import ResultError
from wsnsim.recording.folder import Folder

NAN: Final = float("nan")
MOST_LATE: Final = 0.05
"""Share of steps with a late or missing estimate above which the network may have decided [our choice]."""
READ: Final = ("replicate", "late", "reports", "delay", "handover_bits")


class PointTraffic(NamedTuple):
    """What the network made of a point's estimates.

    Attributes:
        late: share of the steps whose estimate came after the next step began.
        missing: share of the steps without an estimate.
        delay: median latency at the cluster head in s.
        step: duration of a step in s.
        handover: mean airtime in s of the bits of a handover; NaN without one, or if packets take no time.
        timed: whether packets take time. Where they do not, a missing estimate is not their fault.
        particles: the tracker's number of particles, None without.
        kind: the tracker's kind.
    """

    late: float = NAN
    missing: float = NAN
    delay: float = NAN
    step: float = NAN
    handover: float = NAN
    timed: bool = False
    particles: int | None = None
    kind: str = ""

    @property
    def is_late(self) -> bool:
        """Whether estimates are late, missing where packets take time, or the latency or a handover fills the step."""
        absent = self.late + (self.missing if self.timed else 0.0)
        return absent > MOST_LATE or self.delay > self.step or self.handover > self.step


def traffic(folder: Folder, numbers: Iterable[int]) -> list[PointTraffic]:
    """The traffic of points by their numbers in the manifest; unknown where their tables or scenarios are missing."""
    points, tracks = folder.manifest().points, _tracks(folder)
    found = []
    for number in numbers:
        rows = tracks[tracks[campaigns.POINT] == number] if tracks is not None else None
        try:
            found.append(_of_point(json.loads(folder.scenario(points[number].id)), rows))
        except ResultError:
            found.append(PointTraffic())
    return found


def hint(here: PointTraffic, there: PointTraffic, names: tuple[str, str]) -> str:
    """What beside the filters may have decided between a point and its baseline; '' if nothing is known."""
    pair = list(zip(names, (here, there), strict=True))
    found = []
    if here.is_late or there.is_late:
        found.append("packets, not the filter, may have decided: " + "; ".join(_latency(*one) for one in pair))
    if here.kind != there.kind and here.particles and there.particles and here.particles != there.particles:
        words = " and ".join(f"{name} has {one.particles} particles" for name, one in pair)
        found.append(f"the numbers of particles differ: {words}")
    return "; ".join(found)


def _tracks(folder: Folder) -> pd.DataFrame | None:
    """The columns of `tracks` with the steps of their runs; None if they were not recorded."""
    try:
        tracks = campaigns.read(folder.path, "tracks", READ, ("handover_bits",))
    except ResultError:
        return None
    keys = [campaigns.POINT, "replicate"]
    runs = campaigns.read(folder.path, "runs", ("replicate", "steps"))
    return tracks.merge(runs[[*keys, "steps"]], on=keys)


def _of_point(scenario: dict[str, Any], tracks: pd.DataFrame | None) -> PointTraffic:
    tracker = scenario.get("tracker", {})
    particles, kind = tracker.get("particles"), tracker.get("kind", "")
    if tracks is None or not len(tracks) or not tracks["steps"].sum():
        return PointTraffic(particles=particles, kind=kind)
    steps, late, reports = (float(tracks[name].sum()) for name in ("steps", "late", "reports"))
    missing = steps - reports
    rate = scenario.get("mac", {}).get("rate")
    bits = _mean(tracks["handover_bits"].to_numpy(dtype=np.float64))
    delays = tracks["delay"].dropna().to_numpy(dtype=np.float64)
    return PointTraffic(
        (late - missing) / steps,
        missing / steps,
        float(np.median(delays)) if delays.size else NAN,
        float(scenario["step"]),
        bits / rate if rate else NAN,
        bool(rate),
        particles,
        kind,
    )


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else NAN


def _latency(name: str, one: PointTraffic) -> str:
    """How late a point's estimates were, against the duration of its step."""
    if not math.isfinite(one.late):
        return f"{name}: not recorded"
    words = f"{name}: {one.late:.0%} of the steps late, {one.missing:.0%} missing"
    if math.isfinite(one.delay):
        words += f", median latency {one.delay:.2g} s"
    if math.isfinite(one.handover):
        words += f", {one.handover:.2g} s of airtime a handover"
    return f"{words} (step {one.step:g} s)"
