"""The answers to docs/registered/reality.txt, and what the rows say beside them.

    answers(data) -> [Answer, ...]      gaps(data) -> [Gap, ...]      conclusions(data) -> [line, ...]

A median is that of the runs' values; of several tracks, sums or medians of the tracks' medians, as registered. All runs
of all variants are resampled together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.papers.toolkit import Answer, Data, Floats, Interval, OwnMeasure, both, interval, resamples, sample, word

from .recording import TrackFolder, figures_in_words, recording

MEASURES: Final[dict[str, OwnMeasure]] = {}
MEMORYLESS: Final = "trilateration"


class Gap(NamedTuple):
    """The RMSE of a tracker on recorded readings over that on simulated ones, by track, and the median over tracks."""

    tracker: str
    tracks: Mapping[str, Interval]
    median: float


def tracks_of(data: Data) -> TrackFolder:
    """The recording whose tracks the variants have."""
    return recording(Path(data.scenario(data.variants[0])["motion"]["path"]).parent)


def trackers_on(data: Data, words: str, last: str = "") -> list[str]:
    """The trackers of the variants 'TRACK, words, TRACKER', followed by `last` if it is given."""
    first = f"{tracks_of(data).tracks[0].name}, {words}, "
    tails = [name.removeprefix(first) for name in data.variants if name.startswith(first)]
    ends = [tail.removesuffix(f", {last}") for tail in tails if tail.endswith(f", {last}")] if last else tails
    return [tail for tail in ends if ", " not in tail]


def medians(data: Data, variant: str, column: str = "rmse") -> Floats:
    """(1 + draws,) the median over the runs as they are, and of every resample."""
    return resamples(sample(data, variant, f"median:{column}"))


def answers(data: Data) -> list[Answer]:
    """The answers to the three registered hypotheses, in their order."""
    wanted = data.registered
    return [_gap(data, wanted), _recovered(data, wanted), _consistency(data, wanted)]


def _gap(data: Data, wanted: Mapping[str, Any]) -> Answer:
    """Hypothesis 1: on rectangular tracks, before calibration."""
    names = [track.name for track in tracks_of(data).tracks if track.rectangular]
    words = f"on rectangular tracks RMSE recorded / simulated > {wanted['factor']:g}"
    if not names:
        return Answer(f"{words}: no track is rectangular", (), "undecided")
    real, twin = (_summed(data, names, f"{word}, {wanted['tracker']}") for word in ("recorded", "simulated"))
    found = interval(real / twin)
    return Answer(f"{words} ({', '.join(names)})", (found,), word(found.above(wanted["factor"])))


def _recovered(data: Data, wanted: Mapping[str, Any]) -> Answer:
    """Hypothesis 2: the share of the gap that known gains recover."""
    names = [track.name for track in tracks_of(data).tracks]
    states = ("recorded", "recorded, gains", "simulated")
    before, after, twin = (_summed(data, names, f"{word}, {wanted['tracker']}") for word in states)
    found = interval((before - after) / (before - twin))
    return Answer(f"known gains recover >= {wanted['recovered']:g} of the gap", (found,),
                  word(found.above(wanted["recovered"])))  # fmt: skip


def _consistency(data: Data, wanted: Mapping[str, Any]) -> Answer:
    """Hypothesis 3: the NEES before and after the gains."""
    names = [track.name for track in tracks_of(data).tracks]
    before, after = (
        interval(np.median([medians(data, f"{name}, {word}, {wanted['tracker']}", "nees") for name in names], axis=0))
        for word in ("recorded", "recorded, gains")
    )
    holds = both(before.above(wanted["nees"]), after.below(wanted["nees"]))
    return Answer(f"NEES > {wanted['nees']:g} before the gains and below it after", (before, after), word(holds))


def gaps(data: Data, before: str = "recorded", twin: str = "simulated", last: str = "") -> list[Gap]:
    """The gap of every tracker that runs on both, the greatest median first."""
    names = [track.name for track in tracks_of(data).tracks]
    both = [kind for kind in trackers_on(data, before) if kind in trackers_on(data, twin, last)]
    found = []
    for kind in both:
        ends = f"{kind}, {last}" if last else kind
        by_track = {
            name: interval(medians(data, f"{name}, {before}, {kind}") / medians(data, f"{name}, {twin}, {ends}"))
            for name in names
        }
        found.append(Gap(kind, by_track, float(np.median([each.value for each in by_track.values()]))))
    return sorted(found, key=lambda gap: -gap.median)


def conclusions(data: Data) -> list[str]:
    """A line for each hypothesis, and lines on all trackers and on the readings themselves."""
    lines = [f"registered {number}: {each}" for number, each in enumerate(answers(data), 1)]
    return [*lines, *above(data), *on_memory(data), *figures_in_words(tracks_of(data))]


def above(*several: Data) -> list[str]:
    """A line that says how many trackers exceed the registered factor on every rectangular track."""
    threshold = several[0].registered["factor"]
    rectangular = [track.name for track in tracks_of(several[0]).tracks if track.rectangular]
    found = [gap for data in several for gap in gaps(data)]
    if not rectangular:
        return []
    names = [gap.tracker for gap in found if all(gap.tracks[name].value > threshold for name in rectangular)]
    words = f" ({', '.join(names)})" if names else ""
    return [
        f"{len(names)} of {len(found)} trackers have a factor above {threshold:g} on every rectangular track{words}"
    ]


def on_memory(data: Data) -> list[str]:
    """Lines on the tracks on which a tracker without memory is ahead of all filters."""
    ahead = {state: _memoryless_ahead(data, state) for state in ("recorded", "simulated")}
    count = len(tracks_of(data).tracks)
    filters = ", ".join(kind for kind in trackers_on(data, "recorded") if kind != MEMORYLESS)
    return [
        f"{state} readings: memoryless {MEMORYLESS} is ahead of {filters} on {len(names)} of {count} tracks"
        + (f" ({', '.join(names)})" if names else "")
        for state, names in ahead.items()
    ]


def _memoryless_ahead(data: Data, state: str) -> list[str]:
    """The tracks on which the memoryless tracker has a smaller median RMSE than every filter."""
    filters = [kind for kind in trackers_on(data, "recorded") if kind != MEMORYLESS]
    names = [track.name for track in tracks_of(data).tracks]
    return [
        name
        for name in names
        if all(
            medians(data, f"{name}, {state}, {MEMORYLESS}")[0] < medians(data, f"{name}, {state}, {kind}")[0]
            for kind in filters
        )
    ]


def _summed(data: Data, names: Sequence[str], words: str) -> Floats:
    """(1 + draws,) the medians of 'TRACK, words', summed over tracks."""
    total: Floats = np.sum([medians(data, f"{name}, {words}") for name in names], axis=0)
    return total


SUMMARIES: Final = {"conclusions": conclusions, "above": above}
