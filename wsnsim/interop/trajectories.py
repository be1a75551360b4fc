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

from wsnsim.base.arrays import Floats, since
from wsnsim.base.errors import RunError, UsageError, printable
from wsnsim.interop.conventions import decimal, local_metres, origin_note
from wsnsim.interop.traces import Trace
from wsnsim.models.bounds import LENGTH
from wsnsim.models.node_file import FromFile
from wsnsim.models.recorded_track import LATEST
from wsnsim.models.unit_checks import unlikely_speeds
from wsnsim.recording.atomic_files import write_text_atomically

CENTRE: Final = "centre"
LONGEST_STEM: Final = 60
"""Characters of a node's name in the name of its file."""
FARTHEST: Final = 1e9
"""m: greatest coordinate of a recorded track."""
LONGEST_GAP, MOST_SPANS = 3.0, 3
"""Pauses longer than `STEP` and so many times the interval that 90 % of samples keep are absences; spans in a note."""
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
        sampled: Whether tracks are samples with a usual interval, so that a node is absent where it has none.
    """

    metres: float = 1.0
    seconds: float = 1.0
    start: float | None = None
    end: float | None = None
    time_origin: float | None = None
    origin: tuple[float, ...] | str | None = None
    degrees: bool = False
    sampled: bool = False


Intervals = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class PlacedTracks:
    """Tracks in SI units.

    Attributes:
        tracks: {node: (n, 4) time, x, y, z}.
        origin: The place (m) of the file that is their (0, 0).
        presence: {node: the intervals (s) in which it is there}, for nodes that are not there all the time.
        notes: What a reader of the tracks should know, such as absences.
    """

    tracks: Mapping[str, Floats]
    origin: tuple[float, float]
    presence: Mapping[str, Intervals]
    notes: tuple[str, ...] = ()

    @property
    def first(self) -> float:
        """The first time (s) of all tracks."""
        return min(float(track[0, 0]) for track in self.tracks.values())


def placed(trace: Trace, how: Placement) -> PlacedTracks:
    """The tracks of a trace in SI units, within the window of time that is asked for, about the origin.

    Raises:
        UsageError: The window has no part of a track.
        RunError: A coordinate is too large.
    """
    scale = np.array([how.seconds, how.metres, how.metres, how.metres])
    whole, notes = {node: track * scale for node, track in trace.tracks.items()}, list[str]()
    if how.degrees:
        whole, about = _projected(whole, how.origin)
        notes.append(about)
    first, last = (min(track[0, 0] for track in whole.values()), max(track[-1, 0] for track in whole.values()))
    start, end = (own if given is None or math.isinf(given) else given
                  for given, own in ((how.start, first), (how.end, last)))  # fmt: skip
    tracks = {node: _window(trace.path, node, track, start, end) for node, track in whole.items()}
    origin = (0.0, 0.0) if how.degrees else _origin(tracks, how.origin)
    shift = how.time_origin or 0.0
    tracks = {node: np.column_stack([since(track[:, 0], shift), track[:, 1:] - (*origin, 0.0)])
              for node, track in tracks.items()}  # fmt: skip
    for node, track in tracks.items():
        if (np.abs(track[:, 1:]) > FARTHEST).any():
            raise RunError(
                f"{trace.path}: node {node}: x, y and z must be within ±{FARTHEST:g} m: give --unit or --origin"
            )
        if (np.abs(track[:, 0]) > LATEST).any():
            raise RunError(f"{trace.path}: node {node}: times must be within ±{LATEST:g} s: give --time-unit")
    doubts = {node: unlikely_speeds(*track[:, :3].T) for node, track in tracks.items() if how.sampled}
    notes += [f"'{node}' {said}" for node, said in doubts.items() if said]
    presence = _presence(whole, tracks, shift) if how.sampled else {}
    return PlacedTracks(tracks, origin, presence, (*notes, *map(_absences, presence.items())))


def _presence(whole: Mapping[str, Floats], tracks: Mapping[str, Floats], shift: float) -> dict[str, Intervals]:
    """{node: the intervals in which it is there} of nodes with long pauses between samples, or for a part of the time.

    Args:
        whole: {node: its track as it is in the file}.
        tracks: {node: the part of it within the window}, after the time origin.
        shift: The time origin in s.
    """
    first, last = (min(track[0, 0] for track in tracks.values()), max(track[-1, 0] for track in tracks.values()))
    found = {}
    for node, track in tracks.items():
        times = since(whole[node][:, 0], shift)
        apart = np.diff(times)
        long = np.flatnonzero(apart > max(LONGEST_GAP * np.quantile(apart, 0.9, method="lower"), STEP))
        spans = np.column_stack([[times[0], *times[1:][long]], [*times[:-1][long], times[-1]]])
        spans = spans.clip(track[0, 0], track[-1, 0])
        found[node] = tuple((begin, end) for begin, end in spans.tolist() if begin < end)
    return {node: spans for node, spans in found.items() if spans != ((first, last),)}


def _absences(named: tuple[str, Intervals]) -> str:
    """The sentence about a node that is not there all the time."""
    spans = [f"{begin:.10g} to {end:.10g} s" for begin, end in named[1]]
    more = f" and {len(spans) - MOST_SPANS:,} more intervals" if len(spans) > MOST_SPANS else ""
    return f"'{named[0]}' is there from {', '.join(spans[:MOST_SPANS])}{more}: its `presence` says so; remove it if not"


def _projected(tracks: dict[str, Floats], origin: tuple[float, ...] | str | None) -> tuple[dict[str, Floats], str]:
    """Tracks of degrees in local metres, and the sentence that names their origin."""
    every = np.concatenate(list(tracks.values()))
    given = origin if isinstance(origin, tuple) else None
    x, y, about = local_metres(every[:, 1], every[:, 2], np.ones(len(every), dtype=np.bool_), given)
    ends = np.cumsum([len(track) for track in tracks.values()])[:-1]
    pieces = np.split(np.column_stack([every[:, 0], x, y, every[:, 3]]), ends)
    return dict(zip(tracks, pieces, strict=True)), origin_note(about)


def _window(path: str, node: str, track: Floats, start: float, end: float) -> Floats:
    """The part of a track between two times, interpolated at both. Raises UsageError if there is none."""
    known = float(track[0, 0]), float(track[-1, 0])
    start, end = max(start, known[0]), min(end, known[1])
    if not start < end:
        raise UsageError(f"{path}: node {node} is known from {known[0]:.15g} to {known[1]:.15g} s: no time is left "
                         f"between {start:.15g} and {end:.15g} s")  # fmt: skip
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
    return str(table.to_csv(index=False, float_format=decimal, lineterminator="\n"))


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


def motion_block(found: PlacedTracks, files: Mapping[str, Path]) -> str:
    """The lines of a scenario in which the nodes are targets, each at its times, from the first time of all."""
    lines = []
    for node, path in files.items():
        spans = [
            f"[{max(begin, 0.0):.10g}, {end:.10g}]"
            for begin, end in since(np.reshape(found.presence.get(node, ()), (-1, 2)), found.first).tolist()
        ]
        there = f", presence: [{', '.join(spans)}]" if node in found.presence else ""
        lines.append(
            f"{{kind: recorded_track, path: {_quoted(path.name)}, time_origin: {decimal(found.first)}, q: 1{there}}}"
        )
    return f"motion: {lines[0]}" if len(lines) == 1 else "\n".join(["targets:", *(f"  - {line}" for line in lines)])


def _scenario_text(
    placed_tracks: PlacedTracks, files: Mapping[str, Path], name: str, source: str, nodes: Path | None, count: int
) -> str:
    """The text of the scenario."""
    tracks = placed_tracks.tracks
    last = max(float(track[-1, 0]) for track in tracks.values())
    steps = max(2, math.floor(since(last, placed_tracks.first) / STEP + 1e-9))
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
{motion_block(placed_tracks, files)}
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
