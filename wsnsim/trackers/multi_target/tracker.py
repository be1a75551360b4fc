"""The step that all trackers of several targets have in common.

predict -> for each scan, in the order of node numbers: gate, associate, update -> judge tracks -> start new ones
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.detections import why_no_detections
from wsnsim.base.errors import Issue
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import KnownNodes, Tracker
from wsnsim.base.scans import Facts, Scan, ScanOutcome, TrackEstimate, TrackEvent
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.multi_target.frames import (
    LEAST_SEEN,
    Belief,
    BelievedTrack,
    Frame,
    frame_of,
    in_order,
    moments_of,
    picked,
    some,
    stacked,
    visible,
)
from wsnsim.trackers.multi_target.initiation import Start, can_start, found
from wsnsim.trackers.multi_target.management import MOfN, TrackRules, with_hit, without_duplicates
from wsnsim.trackers.shared.gaussian_port import GaussianPort
from wsnsim.trackers.shared.triggers import Always, issues_of

MOST_EXACT: Final = 10
"""Clusters in which both tracks and detections are more than this are associated by belief propagation."""
EXPLAINED: Final = 0.5
"""A detection that came from a track with this probability starts no other one (our choice)."""
SCORE_CYCLES: Final = 60.0
"""CPU cycles to compare one detection with one Gaussian: an innovation, its square and an exponential."""


@part
class MultiTargetTracker:
    """Base of trackers of several targets. A subclass processes a scan."""

    multi_target: ClassVar[bool] = True
    angles: ClassVar[bool] = True
    vector_readings: ClassVar[bool] = True
    estimates_existence: ClassVar[bool] = False

    filter: Annotated[Tracker[Any], OfRole("tracker"), "the Gaussian filter of each track: ekf, ukf, ckf or imm"]
    management: Annotated[TrackRules, OfRole("management"), "when tracks start, count, end and merge"] = MOfN()
    gate: Annotated[
        float, Quantity("", gt=0, le=1), "probability that a target's own detection lies in its gate; 1: open"
    ] = 0.9999

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a filter that is not Gaussian, and for readings from which no track can start."""
        if not hasattr(self.filter, "gaussian"):
            yield Issue(("tracker", "filter"), "needs a filter with Gaussian moments: ekf, ukf, ckf or imm")
        for key, only_value in (("readings", "all"), ("iterations", 1)):
            if getattr(self.filter, key, only_value) != only_value:
                yield Issue(("tracker", "filter", key), f"must be {only_value}: a track's filter takes each scan once")
        if getattr(self.filter, "trigger", Always()) != Always():
            yield Issue(("tracker", "filter", "trigger"), "must be always: a head takes all scans, also empty ones")
        for issue in issues_of(self.filter, setup):
            yield replace(issue, path=("tracker", "filter", *issue.path[1:]))
        if self.management.starts and not can_start(setup.filter_sensor) and not why_no_detections(setup.sensor):
            yield Issue(("tracker", "management"), "tracks start from ranges or bearings; use known with this sensor")
        if any(len(motion.position) != 2 for motion in setup.filter_motions):
            yield Issue(("tracker", "kind"), "needs a motion model whose position has two columns")

    def begin(self, priors: Sequence[Estimate], time: float, facts: Facts, number: int = 0) -> Belief:
        """The belief in targets that are known at the start: confirmed tracks with the numbers from `number` on."""
        port = self._port(facts)
        begun = [self._begun(port, prior.mean, prior.cov, number + i, time) for i, prior in enumerate(priors)]
        return Belief(time, tuple(replace(track, confirmed=True) for track in begun))

    def step(
        self, belief: Belief, time: float, scans: Sequence[Scan], nodes: KnownNodes, facts: Facts, number: int
    ) -> ScanOutcome:
        """The belief at a time, after the scans of then, and what happened to its tracks.

        Args:
            belief: That of a whole number of steps before.
            time: The time in s.
            scans: What arrived; a node that scanned and detected nothing sends an empty scan.
            nodes: Their nodes, in any order, and others.
            facts: What the head assumes.
            number: That of the first track that starts now.
        """
        port, ordered, cycles = self._port(facts), in_order(scans, nodes), 0.0
        tracks = self._predicted(belief, time, port, facts)
        explained = [np.zeros(len(values)) for values in ordered.detections]
        if tracks and scans:
            seen = visible(tracks, ordered, port, facts)
            near = np.flatnonzero(seen.max(axis=0) > facts.probability * LEAST_SEEN)
            heard, taken = some(ordered, near), [explained[sensor] for sensor in near.tolist()]
            frame = frame_of(tracks, heard, seen[:, near], port, facts)
            limit = _limit(self.gate, frame.periods.size)
            for sensor, values in enumerate(heard.detections):
                taken[sensor][:] = self._scan(frame, sensor, values, limit, facts)
                cycles += frame.means.size * frame.means.shape[1] * 2.0 + len(frame.means) * len(values) * SCORE_CYCLES
            tracks = self._closed(tracks, frame, taken)
        else:
            tracks = [with_hit(track, 0.0, 0.0, self.management.window) for track in tracks]
        judged, events = self._judged(tracks, time, facts)
        if self.management.starts:
            free = [share < EXPLAINED for share in explained]
            for place, start in enumerate(found(free, ordered, facts, self.management)):
                judged.append(self._started(port, start, number + place, time, facts))
                events.append(TrackEvent("start", number + place))
                for sensor, row in enumerate(start.used):
                    explained[sensor][row : row + 1] = 1.0  # none where the row is -1
        shares = [np.empty(0)] * len(scans)
        for place, order, share in zip(ordered.given, ordered.places, explained, strict=True):
            shares[place] = share[np.argsort(order)]
        return ScanOutcome(Belief(time, tuple(judged)), tuple(events), tuple(shares), cycles)

    def estimates(self, belief: Belief, facts: Facts) -> list[TrackEstimate]:
        """The estimate of each track: the moments of its first component. Existence is NaN if it is not estimated."""
        own, tells = self._port(facts).own, self.estimates_existence or self.management.tests_existence
        result = []
        for track in belief.tracks:
            mean, cov = moments_of(track.bank, 0)
            existence = track.existence if tells else math.nan
            values = mean[own], cov[np.ix_(own, own)], existence, track.confirmed, track.since
            result.append(TrackEstimate(track.number, *values))
        return result

    def numbers_of(self, belief: Belief) -> int:
        """How many numbers are sent: moments, weights and probabilities of modes; 4 of management a track."""
        total = 0
        for track in belief.tracks:
            components, modes, size = track.bank.means.shape
            total += 4 + components * (1 + modes * (size + size * (size + 1) // 2) + (modes if modes > 1 else 0))
            total += sum(len(step) for history in track.histories for step in history)
        return total

    def only(self, belief: Belief, numbers: Collection[int]) -> Belief:
        """The belief about some of its tracks alone."""
        return Belief(belief.time, tuple(track for track in belief.tracks if track.number in numbers))

    def joined(self, beliefs: Sequence[Belief], time: float, facts: Facts) -> Belief:
        """A belief with the tracks of several, predicted for a time; that says nothing for or against a target."""
        port = self._port(facts)
        tracks = [track for belief in beliefs for track in self._predicted(belief, time, port, facts)]
        return Belief(time, tuple(sorted(tracks, key=lambda track: track.number)))

    def _scan(self, frame: Frame, sensor: int, values: Floats, limit: float, facts: Facts) -> Floats:
        """Update all components with a scan; (M,) the probability that each detection came from a track."""
        raise NotImplementedError

    def _port(self, facts: Facts) -> GaussianPort:
        port: GaussianPort = self.filter.gaussian(facts.motion)  # type: ignore[attr-defined]
        return port

    def _begun(self, port: GaussianPort, mean: Floats, cov: Floats, number: int, time: float) -> BelievedTrack:
        """A track with one component, whose target exists."""
        return BelievedTrack(number, np.ones(1), port.begun(mean, cov), time)

    def _started(self, port: GaussianPort, start: Start, number: int, time: float, facts: Facts) -> BelievedTrack:
        """A new track at a fix; its other columns are 0 with the spread of the management."""
        place, size = list(facts.motion.position), len(facts.motion.columns)
        mean, cov = np.zeros(size), self.management.rate_sd**2 * np.eye(size)
        mean[place], cov[np.ix_(place, place)] = start.point, start.cov
        track = self._begun(port, mean, cov, number, time)
        tells = self.estimates_existence or self.management.tests_existence
        existence = 1.0 / (1.0 + math.exp(-min(start.odds, 700.0))) if tells else 1.0  # 1: not estimated
        return replace(track, hits=(True,), existence=existence)

    def _predicted(self, belief: Belief, time: float, port: GaussianPort, facts: Facts) -> list[BelievedTrack]:
        """The tracks at a time."""
        steps = round((time - belief.time) / facts.dt)
        if not belief.tracks or not steps:
            return list(belief.tracks)
        bank, survival = stacked(track.bank for track in belief.tracks), self.management.survival**steps
        for step in range(steps):
            bank = port.predicted(bank, facts.dt, belief.time + step * facts.dt)
        cuts = np.cumsum([0, *(len(track.weights) for track in belief.tracks)]).tolist()
        return [
            replace(track, bank=picked(bank, slice(*cuts[i : i + 2])), existence=track.existence * survival)
            for i, track in enumerate(belief.tracks)
        ]

    def _closed(self, tracks: list[BelievedTrack], frame: Frame, explained: list[Floats]) -> list[BelievedTrack]:
        """The tracks after all scans, the heaviest component of each first."""
        bank, expected, result = frame.bank(), frame.seen.sum(axis=1), []
        for row, track in enumerate(tracks):
            mine = np.flatnonzero(frame.owners == row)
            mine = mine[np.argsort(-frame.weights[mine], kind="stable")]
            result.append(with_hit(
                track, frame.assigned[row], expected[row], self.management.window, weights=frame.weights[mine],
                bank=picked(bank, mine), existence=float(frame.existence[row]),
            ))  # fmt: skip
        return result

    def _judged(
        self, tracks: list[BelievedTrack], time: float, facts: Facts
    ) -> tuple[list[BelievedTrack], list[TrackEvent]]:
        """The tracks that stay, some of them confirmed now, and what happened to the others."""
        kept: list[BelievedTrack] = []
        events: list[TrackEvent] = []
        for track in tracks:
            verdict = self.management.judge(track)
            if verdict != "stay":
                events.append(TrackEvent(verdict, track.number))
            if verdict != "delete":
                kept.append(replace(track, confirmed=track.confirmed or verdict == "confirm"))
        if len(kept) < 2 or not self.management.starts or not self.management.duplicate:
            return kept, events
        kept, merged = without_duplicates(kept, self.estimates(Belief(time, tuple(kept)), facts), self.management)
        return kept, events + merged


@lru_cache(maxsize=64)
def _limit(gate: float, size: int) -> float:
    """The squared distance within which an innovation of `size` components lies with the probability `gate`."""
    from scipy.special import chdtri

    return float(chdtri(size, 1.0 - gate)) if gate < 1.0 else math.inf


def alive(shares: Floats, existence: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """The probability (T,) that targets exist after a scan, and (T,) that they exist and made no detection.

    Args:
        shares: (T, M + 1) association probabilities, the first of no detection.
        existence: (T,) before the scan.
        seen: (T,) the probability that a target that exists makes a detection in its gate.
    """
    missed = existence * (1.0 - seen) / np.maximum(1.0 - existence * seen, 1e-300)
    silent = shares[:, 0] * np.minimum(missed, 1.0)
    return np.minimum(shares[:, 1:].sum(axis=1) + silent, 1.0), silent
