"""The replay of a run in a browser: who is where at each step, quantised and compressed to text.

`encode(path, replicate, room)` gives the text, which static/replay_data.js reads. `replay_encoding` defines its format,
and `replay_tracks`, `replay_nodes`, `replay_clusters` and `replay_traffic` its content.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis.replicate_tables import ReplicateTables, read_replicate
from wsnsim.report.replay_clusters import add_clusters
from wsnsim.report.replay_encoding import MISSING, DetailLevel, ReplayEncoder
from wsnsim.report.replay_nodes import add_nodes
from wsnsim.report.replay_tracks import add_particles, add_tracks
from wsnsim.report.replay_traffic import add_traffic

MAX_FRAMES: Final = 20_000
"""Frames above which steps are thinned, whatever the room (our choice)."""
TRAJECTORY, TRAIL = 1000, 60
"""Frames of the ground-truth trajectory drawn before and after the current one; frames drawn in bold (our choice)."""
MIN_ROOM: Final = 300
"""Characters that the shortest replay takes."""
DETAILS: Final = (
    DetailLevel(),
    DetailLevel(particles=400, links=500),
    DetailLevel(1, 50_000, 200, 200, 127),
    DetailLevel(1, 50_000, 100, 100, 63),
    DetailLevel(2, 20_000, 100, 100, 63),
    DetailLevel(5, 20_000, 50, 50, 31),
    DetailLevel(10, 10_000, 50, 50, 31),
    DetailLevel(50, 5_000, 0, 30, 15),
    DetailLevel(200, 2_000, 0, 0, 7),
)
"""From full detail to little: the first whose text fits is used (our choice)."""


@dataclass(frozen=True)
class Replay:
    """A replay as text, '' if there is none, and notes on what is thinned or was not recorded."""

    text: str
    notes: tuple[str, ...]


def encode(path: str | Path, replicate: int, room: int) -> Replay:
    """The replay of a run, in at most `room` characters.

    Raises:
        UsageError: the result has no such replicate.
        ResultError: the result cannot be read.
    """
    run = read_replicate(path, replicate)
    missing = run.missing()
    if not (run.truth or run.guess or (run.nodes and run.events)):
        return Replay("", ("There is nothing to replay.", *_sentences(missing)))
    for detail in DETAILS if room >= MIN_ROOM else ():
        stride = max(detail.stride, -(-run.last // MAX_FRAMES))
        header, encoder = _encoded(run, detail._replace(stride=stride))
        notes = _sentences([*encoder.notes, *missing])
        text = encoder.text(header | {"notes": notes})
        if len(text) <= room:
            return Replay(text, notes)
    return Replay("", (f"The replay was left out: even thinned, it takes more than {max(room, 0):,} characters.",))


def _sentences(notes: list[str]) -> tuple[str, ...]:
    return tuple(f"{note[0].upper()}{note[1:]}." for note in notes)


def ordinal(number: int) -> str:
    """1st, 2nd, 3rd, 11th."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number:,}{ending}"


def _encoded(run: ReplicateTables, detail: DetailLevel) -> tuple[dict[str, Any], ReplayEncoder]:
    """The header and the columns of a run at one level of detail."""
    encoder = ReplayEncoder.empty(run, detail)
    charge = add_nodes(encoder) if run.nodes else None
    add_tracks(encoder)
    if run.events and run.nodes:
        add_clusters(encoder)
        add_traffic(encoder)
    if run.cloud:
        add_particles(encoder)
    _add_notes(encoder)
    header = {
        "last": run.last, "stride": detail.stride, "frames": encoder.frames, "targets": run.targets,
        "box": encoder.box, "dt": run.dt if np.isfinite(run.dt) else None, "flat": run.flat, "axes": run.axes,
        "messages": run.words, "nodes": encoder.drawn.size, "charge": charge, "trajectory": TRAJECTORY, "trail": TRAIL,
    }  # fmt: skip
    return header, encoder


def _add_notes(encoder: ReplayEncoder) -> None:
    """Notes on thinned steps, on how much of a trajectory is drawn, and on rounding."""
    run, stride = encoder.run, encoder.detail.stride
    if stride > 1:
        note = f"every {ordinal(stride)} step of {run.last:,} is drawn"
        if run.events:
            note += ", together with what happened since the previous one"
        encoder.notes.insert(0, note)
    if (run.truth or run.guess) and encoder.frames > TRAIL:
        frames = "drawn steps" if stride > 1 else "steps"
        note = f"trajectories are drawn in bold for the last {TRAIL} {frames}"
        if encoder.frames > TRAJECTORY:
            note += f"; the ground truth is drawn for {TRAJECTORY:,} before and after"
        encoder.notes.append(note)
    side = max(encoder.box[2] - encoder.box[0], encoder.box[3] - encoder.box[1])
    encoder.notes.append(f"positions are rounded to {side / (MISSING - 1):.1g} of the axes' unit")
