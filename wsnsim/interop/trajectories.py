"""What an imported trace becomes: CSV files for `motion: {kind: recorded_track}`, and a scenario that runs.

placed(trace, options) -> {node: (n, 4)}                   units, window of time, origins of time and place
write_csv(tracks, out) -> [path]                           one file a node: time, id, x, y, and z if known
write_scenario(tracks, out, nodes) -> [path]               these files and a scenario beside them
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError, UsageError, printable
from wsnsim.interop import Trace
from wsnsim.interop.conventions import local_metres, origin_note
from wsnsim.models.bounds import LENGTH
from wsnsim.models.node_file import FromFile
from wsnsim.models.recorded_track import LATEST
from wsnsim.recording.atomic_files import write_text_atomically

CENTRE: Final = "centre"
LONGEST_STEM: Final = 60
"""Characters of a node's name in the name of its file."""
FARTHEST: Final = 1e9
"""m: greatest coordinate of a recorded track."""
LONGEST_GAP, MOST_GAPS = 3.0, 3
"""Pauses between samples beyond this many usual intervals are absences, of which so many are named (our choice)."""
SPACING: Final = 40.0
"""m: distance of neighbouring nodes of the grid in a scenario without positions; sensing range 60 m, links 90 m."""
LEAST_NODES, MOST_NODES = 9, 2500
STEP: Final = 1.0


@dataclass(frozen=True, slots=True)
class Placement:
    """How times and places of a trace become those of a track.

    Attributes:
        metres: Metres in the file's unit of length.
        seconds: Seconds in the file's unit of time.
        start: Time (s) from which the track is taken; None for its own beginning.
        end: Time (s) until which it is taken; None for its own end.
        time_origin: Time (s) that becomes 0; None leaves times as they are.
        origin: Place that becomes (0, 0), in m, or in degrees where places are; `centre` for the middle of the tracks'
            extent, None for none.
        degrees: Whether places are longitudes and latitudes, which are projected about the origin.
        sampled: Whether tracks are samples with a usual interval, so that longer pauses are absences.
    """

    metres: float = 1.0
    seconds: float = 1.0
    start: float | None = None
    end: float | None = None
    time_origin: float | None = None
    origin: tuple[float, ...] | str | None = None
    degrees: bool = False
    sampled: bool = False


@dataclass(frozen=True, slots=True)
class PlacedTracks:
    """Tracks in SI units: {node: (n, 4) time, x, y, z}, and the place (m) of the file that is their (0, 0).

    `notes` say what was left out, and between which samples a track is drawn straight.
    """

    tracks: Mapping[str, Floats]
    origin: tuple[float, float]
    notes: tuple[str, ...] = ()


def placed(trace: Trace, how: Placement) -> PlacedTracks:
    """The tracks of a trace in SI units, within the window of time in which all of them are known, about the origin.

    Raises:
        UsageError: The window has no part of a track.
        RunError: A coordinate is too large.
    """
    scale = np.array([how.seconds, how.metres, how.metres, how.metres])
    whole = {node: track * scale for node, track in trace.tracks.items()}
    notes = _gaps(whole) if how.sampled else []
    if how.degrees:
        whole, about = _projected(whole, how.origin)
        notes.append(about)
    start, end = _common_span(trace.path, whole, how)
    notes += _cut(whole, start, end) if how.start is None and how.end is None else []
    tracks = {node: _window(track, start, end) for node, track in whole.items()}
    origin = (0.0, 0.0) if how.degrees else _origin(tracks, how.origin)
    shift = np.array([how.time_origin or 0.0, *origin, 0.0])
    tracks = {node: track - shift for node, track in tracks.items()}
    for node, track in tracks.items():
        if (np.abs(track[:, 1:]) > FARTHEST).any():
            raise RunError(
                f"{trace.path}: node {node}: x, y and z must be within ±{FARTHEST:g} m: give --unit or --origin"
            )
        if (np.abs(track[:, 0]) > LATEST).any():
            raise RunError(f"{trace.path}: node {node}: times must be within ±{LATEST:g} s: give --time-unit")
    return PlacedTracks(tracks, origin, tuple(notes))


def _gaps(tracks: Mapping[str, Floats]) -> list[str]:
    """A sentence for each of the longest absences: pauses between samples of formats that have a usual interval."""
    notes = []
    for node, track in tracks.items():
        apart = np.diff(track[:, 0])
        long = np.flatnonzero(apart > LONGEST_GAP * np.median(apart))
        pauses = track[long[np.argsort(-apart[long])][:MOST_GAPS, None] + [0, 1], 0].tolist()
        notes += [
            f"'{node}' is absent from {start:.10g} to {end:.10g} s: a straight line there" for start, end in pauses
        ]
    return notes


def _cut(tracks: Mapping[str, Floats], start: float, end: float) -> list[str]:
    """The sentence about targets that are there for longer than all of them are, if there are any."""
    longer = [_known(node, track) for node, track in tracks.items() if np.ptp(track[:, 0]) > end - start]
    said = f"only {start:g} to {end:g} s is written, when all targets are there: {', '.join(longer[:MOST_GAPS])}"
    return [said] if longer else []


def _known(node: str, track: Floats) -> str:
    return f"node {node} is known from {track[0, 0]:g} to {track[-1, 0]:g} s"


def _projected(tracks: dict[str, Floats], origin: tuple[float, ...] | str | None) -> tuple[dict[str, Floats], str]:
    """Tracks of degrees in local metres, and the sentence that names their origin."""
    every = np.concatenate(list(tracks.values()))
    given = origin if isinstance(origin, tuple) else None
    x, y, about = local_metres(every[:, 1], every[:, 2], np.ones(len(every), dtype=np.bool_), given)
    ends = np.cumsum([len(track) for track in tracks.values()])[:-1]
    pieces = np.split(np.column_stack([every[:, 0], x, y, every[:, 3]]), ends)
    return dict(zip(tracks, pieces, strict=True)), origin_note(about)


def _common_span(path: str, tracks: Mapping[str, Floats], how: Placement) -> tuple[float, float]:
    """First and last time (s) at which all tracks are known, within the window that was asked for.

    A target is there from the first to the last step of a run: what is known of it before and after is not used.
    """
    first, last = (max(track[0, 0] for track in tracks.values()), min(track[-1, 0] for track in tracks.values()))
    start = first if how.start is None else max(first, how.start)
    end = last if how.end is None else min(last, how.end)
    if not start < end:
        known = ", ".join(_known(node, track) for node, track in tracks.items())
        raise UsageError(f"{path}: {known}: no time is left between {start:g} and {end:g} s")
    return float(start), float(end)


def _window(track: Floats, start: float, end: float) -> Floats:
    """The part of a track between two times, interpolated at both."""
    inside = track[(track[:, 0] > start) & (track[:, 0] < end)]
    ends = [[time, *(np.interp(time, track[:, 0], track[:, column]) for column in (1, 2, 3))] for time in (start, end)]
    return np.vstack([ends[0], inside, ends[1]])


def _origin(tracks: Mapping[str, Floats], wanted: tuple[float, ...] | str | None) -> tuple[float, float]:
    """The place that becomes (0, 0)."""
    if wanted is None:
        return 0.0, 0.0
    if isinstance(wanted, tuple):
        return wanted[0], wanted[1]
    places = np.concatenate([track[:, 1:3] for track in tracks.values()])
    x, y = np.round((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
    return x, y


def files_of(tracks: Mapping[str, Floats], out: Path) -> dict[str, Path]:
    """The CSV file of each node: `out` itself for one, `out` with the node's name for several."""
    if len(tracks) == 1 and out.suffix == ".csv":
        return dict.fromkeys(tracks, out)
    stems = {node: re.sub(r"[^\w.-]", "_", node)[:LONGEST_STEM] for node in tracks}
    if len(set(stems.values())) < len(stems):
        stems = {node: f"{number}_{stem}" for number, (node, stem) in enumerate(stems.items())}
    return {node: out.with_name(f"{out.stem}_{stem}.csv") for node, stem in stems.items()}


def write_csv(tracks: Mapping[str, Floats], out: Path) -> list[Path]:
    """Write one file a node, each as a whole or not at all. Raises StorageError if one cannot be written."""
    files = files_of(tracks, out)
    for node, path in files.items():
        write_text_atomically(path, csv_text(node, tracks[node]))
    return list(files.values())


def csv_text(node: str, track: Floats) -> str:
    """The rows of a track, as a text with the columns time, id, x, y, and z where it is known everywhere."""
    table = pd.DataFrame(track, columns=["time", "x", "y", "z"]).round({"time": 9, "x": 6, "y": 6, "z": 6}) + 0.0
    table.insert(1, "id", node)
    return _text(table if np.isfinite(track[:, 3]).all() else table.drop(columns="z"))


def _text(table: pd.DataFrame) -> str:
    """A table as CSV."""
    return str(table.to_csv(index=False, float_format="%.15g", lineterminator="\n"))


def write_shifted_nodes(source: Path, out: Path, origin: tuple[float, float]) -> None:
    """Write the positions of a file (columns x, y, perhaps id and z) relative to an origin (m).

    Raises:
        RunError: A position cannot be read. The message names file and line.
        StorageError: The file cannot be written.
    """
    read = _positions(source)
    places = read.draw(0.0, np.random.default_rng(0)) - np.array(origin)
    heights = {} if read.heights is None else {"z": read.heights}
    table = pd.DataFrame({"id": read.names, "x": places[:, 0], "y": places[:, 1], **heights})
    write_text_atomically(out, _text(table.round(6)))


def _positions(path: Path) -> FromFile:
    """The nodes of a file, wherever they stand."""
    return FromFile(path=str(path), fit=True, cover=False, count_from=0)


def write_scenario(placed_tracks: PlacedTracks, out: Path, source: str, nodes: Path | None) -> list[Path]:
    """Write the CSV files and a scenario in which an extended Kalman filter tracks the nodes as targets.

    Args:
        placed_tracks: The tracks.
        out: The scenario's file.
        source: Name of the trace, for the first comment.
        nodes: CSV file with the positions of sensors, in the coordinates of the tracks; None for a grid.

    Raises:
        StorageError: A file cannot be written.
    """
    written, files = write_csv(placed_tracks.tracks, out), files_of(placed_tracks.tracks, out)
    count = MOST_NODES if nodes is None else len(_positions(out.parent / nodes).names)
    write_text_atomically(out, _scenario_text(placed_tracks, files, out.stem, source, nodes, count))
    return [*written, out]


def _scenario_text(
    placed_tracks: PlacedTracks, files: Mapping[str, Path], name: str, source: str, nodes: Path | None, count: int
) -> str:
    """The text of the scenario."""
    tracks = placed_tracks.tracks
    first = min(float(track[0, 0]) for track in tracks.values())
    last = max(float(track[-1, 0]) for track in tracks.values())
    steps = max(2, math.floor((last - first) / STEP + 1e-9))
    motions = [f"{{kind: recorded_track, path: {_quoted(path.name)}, time_origin: {first:.15g}, q: 1}}"
               for path in files.values()]  # fmt: skip
    motion = f"motion: {motions[0]}" if len(motions) == 1 else "targets:\n" + "\n".join(f"  - {m}" for m in motions)
    x, y = placed_tracks.origin
    about = printable(" ".join(source.split()))
    origin = f" The origin of this scenario is the place ({x:.10g}, {y:.10g}) m of that file." if x or y else ""
    origin += "".join(f"\n# {printable(' '.join(note.split()))}" for note in placed_tracks.notes)
    allowed = _quoted(re.sub(r"^\W|[^\w.-]", "_", name, flags=re.ASCII)[:LONGEST_STEM])
    return f"""\
# Trajectories from {about}.{origin}
# Nodes, sensor, radio and tracker are a beginning: replace them by yours.
name: {allowed}
duration: {(steps + 1) * STEP:.17g} s
step: {STEP:g} s
prior: {{sd: [5, 5, 5, 5]}}
{_deployment(tracks, nodes)}
{motion}
sensor: {{kind: range, sd: 2 m, reach: 60 m}}
energy: {{kind: first_order}}
link: {{kind: disk, reach: 90 m}}
clusters: {{kind: strongest_signal{f", minimum_active: {count}" * (count < 3)}}}
tracker: {{kind: ekf}}
"""


def _deployment(tracks: Mapping[str, Floats], nodes: Path | None) -> str:
    """The block `deploy`: the positions of a file, or a grid that covers the tracks."""
    if nodes is not None:
        return f"deploy: {{kind: file, path: {_quoted(str(nodes))}, fit: true, cover: false}}"
    places = np.concatenate([track[:, 1:3] for track in tracks.values()])
    assert LENGTH.le
    width, height = np.minimum(np.ceil(2.0 * np.abs(places).max(axis=0) + 2.0 * SPACING), LENGTH.le).tolist()
    wanted = math.ceil(width / SPACING) * math.ceil(height / SPACING)
    count = min(max(wanted, LEAST_NODES), MOST_NODES)
    return f"deploy: {{kind: grid, nodes: {count}, width: {width:.17g} m, height: {height:.17g} m, cover: false}}"


def _quoted(text: str) -> str:
    """A text as a YAML scalar in quotes."""
    return "'" + text.replace("'", "''") + "'" if text.isprintable() else json.dumps(text)
