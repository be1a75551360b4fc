"""A run as a picture that moves, for a browser: who is where at each step, quantised, compressed, as text.

    pack(path, replicate, room) -> Packed

How the text is made up, `film` says; what is on it, `film_tracks`, `film_nodes`, `film_clusters` and `film_traffic`;
who reads it is page/film.js.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis.replicate_tables import ReplicateTables, read_replicate
from wsnsim.report.replay_clusters import clusters
from wsnsim.report.replay_encoding import MISSING, Film, Plan
from wsnsim.report.replay_nodes import nodes
from wsnsim.report.replay_tracks import particles, tracks
from wsnsim.report.replay_traffic import traffic

MOST_FRAMES: Final = 20_000
"""Frames from which on steps are thinned, whatever the room (our choice)."""
WAY, TRAIL = 1000, 60
"""Frames of the true way that are drawn to either side, and of the latest truth and estimates (our choice)."""
LEAST_ROOM: Final = 300
"""Characters that the shortest replay takes: in less, none is tried."""
PLANS: Final = (
    Plan(),
    Plan(particles=400, links=500),
    Plan(1, 50_000, 200, 200, 127),
    Plan(1, 50_000, 100, 100, 63),
    Plan(2, 20_000, 100, 100, 63),
    Plan(5, 20_000, 50, 50, 31),
    Plan(10, 10_000, 50, 50, 31),
    Plan(50, 5_000, 0, 30, 15),
    Plan(200, 2_000, 0, 0, 7),
)
"""From everything to little: the first one is taken whose text has room (our choice)."""


@dataclass(frozen=True)
class Packed:
    """A replay as text, '' if there is none, and what its viewer must know: what was thinned, what is not recorded."""

    text: str
    notes: tuple[str, ...]


def pack(path: str | Path, replicate: int, room: int) -> Packed:
    """The replay of a run, in at most `room` characters.

    Raises:
        UsageError: the result has no such replicate.
        ResultError: the result cannot be read.
    """
    run = read_replicate(path, replicate)
    missing = run.missing()
    if not (run.truth or run.guess or (run.nodes and run.events)):
        return Packed("", ("There is nothing to replay.", *_sentences(missing)))
    for plan in PLANS if room >= LEAST_ROOM else ():
        header, film = _drawn(run, plan._replace(stride=max(plan.stride, -(-run.last // MOST_FRAMES))))
        notes = _sentences([*film.notes, *missing])
        text = film.text(header | {"notes": notes})
        if len(text) <= room:
            return Packed(text, notes)
    return Packed("", (f"The replay was left out: thinned, too, it takes more than {max(room, 0):,} characters.",))


def _sentences(notes: list[str]) -> tuple[str, ...]:
    return tuple(f"{note[0].upper()}{note[1:]}." for note in notes)


def ordinal(number: int) -> str:
    """1st, 2nd, 3rd, 11th."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number:,}{ending}"


def _drawn(run: ReplicateTables, plan: Plan) -> tuple[dict[str, Any], Film]:
    """A run drawn by a plan."""
    film = Film.blank(run, plan)
    charge = nodes(film) if run.nodes else None
    tracks(film)
    if run.events and run.nodes:
        clusters(film)
        traffic(film)
    if run.cloud:
        particles(film)
    _limits_are_said(film)
    header = {
        "last": run.last, "stride": plan.stride, "frames": film.frames, "targets": run.targets, "box": film.box,
        "dt": run.dt if np.isfinite(run.dt) else None, "flat": run.flat, "axes": run.axes, "words": run.words,
        "nodes": film.picked.size, "charge": charge, "way": WAY, "trail": TRAIL,
    }  # fmt: skip
    return header, film


def _limits_are_said(film: Film) -> None:
    """Notes on thinned steps, on the length of the ways, and on rounding."""
    run, stride = film.run, film.plan.stride
    if stride > 1:
        told = f"every {ordinal(stride)} step of {run.last:,} is drawn"
        if run.events:
            told += "; what was sent, sensed and joined since the one before is drawn with it"
        film.notes.insert(0, told)
    if (run.truth or run.guess) and film.frames > TRAIL:
        frames = "drawn steps" if stride > 1 else "steps"
        told = f"ways are drawn in bold for the last {TRAIL} {frames}"
        film.notes.append(told + (f", the true one for {WAY:,} to either side" if film.frames > WAY else ""))
    side = max(film.box[2] - film.box[0], film.box[3] - film.box[1])
    film.notes.append(f"places are rounded to {side / (MISSING - 1):.1g} of the axes' unit")
