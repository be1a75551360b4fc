"""Management of tracks: when one starts, counts as a target, ends, and is a duplicate of another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Final, Literal

from wsnsim.base.part import Quantity, part
from wsnsim.base.scans import TrackEstimate, TrackEvent
from wsnsim.trackers.multi_target.frames import BelievedTrack, distances

Verdict = Literal["stay", "confirm", "delete"]
RARELY: Final = 0.05
"""A step in which fewer detections than this are expected says nothing about the target (our choice)."""
LEAST_ODDS: Final = math.log(1e-3)
"""Least log-odds of a target with which a track starts that is judged by its hits (our choice)."""
CHANCE: Final = Quantity("", gt=0, lt=0.5)


@part
class TrackRules:
    """Base of the rules by which tracks start, end and merge.

    A new track needs detections of `support` nodes that meet in one place, so that the ghosts of crossing bearings or
    ranges, in which two nodes meet by chance, need a further node that confirms them. A step is a hit if a track got at
    least half of the detections that were to be expected. Of two tracks in the same place for `duplicate_steps` steps,
    the one that is not confirmed, or else the younger, is merged into the other. (All our choice.)
    """

    starts: ClassVar[bool] = True
    known_start: ClassVar[bool] = False
    """Whether the tracks of targets that are present at the start are given, with their priors."""
    tests_existence: ClassVar[bool] = False
    support: Annotated[int, Quantity("", ge=1, le=100), "nodes whose detections must meet in a new track"] = 3
    births: Annotated[
        float, Quantity("", gt=0, le=1e3, label="1/m²"), "expected number of new targets in a step, per square metre"
    ] = 1e-5
    rate_sd: Annotated[
        float, Quantity("", gt=0, le=1e6, label="SI"), "deviation at the start of all columns but the position, in SI"
    ] = 3.0
    duplicate: Annotated[
        float, Quantity("", ge=0, le=100), "standard deviations of their difference within which two tracks are one"
    ] = 0.5
    duplicate_steps: Annotated[int, Quantity("", ge=1, le=1000), "steps in a row for which they must be"] = 5

    @property
    def survival(self) -> float:
        """The probability that a target is still there a step later."""
        return 1.0

    @property
    def least_odds(self) -> float:
        """The least log-odds of a target with which a track starts."""
        return LEAST_ODDS

    @property
    def window(self) -> int:
        """For how many steps a track remembers its hits."""
        return 1

    def judge(self, track: BelievedTrack) -> Verdict:
        """What becomes of a track after a step."""
        raise NotImplementedError


@part
class MOfN(TrackRules):
    """Confirm a track with `hits` hits in its last `window` steps; end it when that is out of reach, or by coasting.

    Source: Blackman, Popoli (1999) for the rule M of N.
    """

    hits: Annotated[int, Quantity("", ge=1, le=100), "hits that confirm a track: M"] = 3
    window: Annotated[int, Quantity("", ge=1, le=100), "steps in which they must be: N"] = 5
    coast: Annotated[int, Quantity("", ge=1, le=10_000), "steps in a row without a hit that end a confirmed track"] = 5

    def __post_init__(self) -> None:
        """Raises ValueError if the window is shorter than the hits."""
        if self.hits > self.window:
            raise ValueError(f"hits: must be at most the window of {self.window} steps, is {self.hits}")

    def judge(self, track: BelievedTrack) -> Verdict:
        """What becomes of a track after a step."""
        if track.misses >= self.coast:
            return "delete"
        if track.confirmed:
            return "stay"
        recent = track.hits[-self.window :]
        if sum(recent) >= self.hits:
            return "confirm"
        left = self.window - len(track.hits)
        return "delete" if sum(recent) + max(left, 0) < self.hits else "stay"


@part
class SequentialTest(TrackRules):
    """Confirm and end a track by a sequential probability ratio test: odds of its existence, with prior odds.

    The odds are those of a birth to begin with, grow with the likelihood ratio of each scan, and fall with the
    probability that a target is gone after a step.

    Source: Wald (1945); Sittler (1964), and Musicki, Evans, Stankovic (1994) for the recursion of the existence.
    """

    tests_existence: ClassVar[bool] = True

    false_confirmation: Annotated[float, CHANCE, "probability that a false track is confirmed"] = 0.01
    false_deletion: Annotated[float, CHANCE, "probability that a true track is deleted"] = 0.01
    survival: Annotated[float, Quantity("", gt=0.5, le=1), "probability that a target is still there a step later"] = (
        0.99
    )

    @property
    def least_odds(self) -> float:
        """The log-odds at which a track would be deleted."""
        return math.log(self.false_deletion / (1.0 - self.false_confirmation))

    def judge(self, track: BelievedTrack) -> Verdict:
        """What becomes of a track after a step."""
        odds = track.existence / max(1.0 - track.existence, 1e-300)
        if odds <= math.exp(self.least_odds):
            return "delete"
        confirms = not track.confirmed and odds >= (1.0 - self.false_deletion) / self.false_confirmation
        return "confirm" if confirms else "stay"


@part
class KnownTargets(TrackRules):
    """The targets are known from the start, and none comes or goes: no track starts, ends or merges."""

    starts: ClassVar[bool] = False
    known_start: ClassVar[bool] = True

    def judge(self, track: BelievedTrack) -> Verdict:
        """Every track stays."""
        return "stay"


def with_hit(track: BelievedTrack, assigned: float, expected: float, window: int, **changes: Any) -> BelievedTrack:
    """The track after a step in which it got a number of detections, where so many were expected, and other changes."""
    hit = assigned >= 0.5 * max(expected, 1.0)
    hits = track.hits if expected < RARELY and not hit else (*track.hits, hit)
    return replace(track, hits=hits[-window:], misses=0 if hit else track.misses + 1, **changes)


def without_duplicates(
    tracks: Sequence[BelievedTrack], estimates: Sequence[TrackEstimate], rules: TrackRules
) -> tuple[list[BelievedTrack], list[TrackEvent]]:
    """The tracks without those that were where a better one is for some steps, and how they were merged."""
    kept: list[BelievedTrack] = []
    events: list[TrackEvent] = []
    close = distances(estimates, list(range(len(estimates[0].mean)))) <= rules.duplicate
    better: list[int] = []
    for place in sorted(range(len(tracks)), key=lambda place: (not tracks[place].confirmed, tracks[place].number)):
        before = dict(tracks[place].near)
        others = [tracks[other].number for other in better if close[place, other]]
        near = {number: before.get(number, 0) + 1 for number in others}
        into = next((number for number, steps in near.items() if steps >= rules.duplicate_steps), None)
        if into is not None:
            events.append(TrackEvent("merge", tracks[place].number, into))
            continue
        better.append(place)
        kept.append(replace(tracks[place], near=tuple(near.items())))
    return sorted(kept, key=lambda track: track.number), events
