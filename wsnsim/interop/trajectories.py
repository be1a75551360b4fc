"""What an imported trace becomes: CSV files for `motion: {kind: recorded_track}`, and a scenario that runs.

placed(trace, options) -> {node: (n, 4)}                   units, window of time, origins of time and place
write_csv(tracks, out) -> [path]                           one file a node: time, id, x, y, and z if known
write_scenario(tracks, out, nodes) -> [path]               these files and a scenario beside them
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError, UsageError, printable
from wsnsim.interop import Trace
from wsnsim.models.bounds import LENGTH
from wsnsim.models.node_file import FromFile
from wsnsim.models.recorded_track import LATEST
from wsnsim.recording.atomic_files import write_text_atomically

CENTRE: Final = "centre"
LONGEST_STEM: Final = 60
"""Characters of a node's name in the name of its file."""
FARTHEST: Final = 1e9
"""m: greatest coordinate of a recorded track."""
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
        origin: Place (m) that becomes (0, 0), `centre` for the middle of the tracks' extent, None for none.
    """

    metres: float = 1.0
    seconds: float = 1.0
    start: float | None = None
    end: float | None = None
    time_origin: float | None = None
    origin: tuple[float, float] | str | None = None


@dataclass(frozen=True, slots=True)
class PlacedTracks:
    """Tracks in SI units: {node: (n, 4) time, x, y, z}, and the place (m) of the file that is their (0, 0)."""

    tracks: Mapping[str, Floats]
    origin: tuple[float, float]


def placed(trace: Trace, how: Placement) -> PlacedTracks:
    """The tracks of a trace in SI units, within the window of time, about the origin.

    Raises:
        UsageError: The window has no part of a track.
        RunError: A coordinate is too large.
    """
    scale = np.array([how.seconds, how.metres, how.metres, how.metres])
    tracks = {node: _window(trace.path, node, track * scale, how) for node, track in trace.tracks.items()}
    origin = _origin(tracks, how.origin)
    shift = np.array([how.time_origin or 0.0, *origin, 0.0])
    tracks = {node: track - shift for node, track in tracks.items()}
    for node, track in tracks.items():
        if (np.abs(track[:, 1:]) > FARTHEST).any():
            raise RunError(
                f"{trace.path}: node {node}: x, y and z must be within ±{FARTHEST:g} m: give --unit or --origin"
            )
        if (np.abs(track[:, 0]) > LATEST).any():
            raise RunError(f"{trace.path}: node {node}: times must be within ±{LATEST:g} s: give --time-unit")
    return PlacedTracks(tracks, origin)


def _window(path: str, node: str, track: Floats, how: Placement) -> Floats:
    """The part of a track between two times, interpolated at both."""
    first, last = float(track[0, 0]), float(track[-1, 0])
    start = first if how.start is None else max(first, how.start)
    end = last if how.end is None else min(last, how.end)
    if not start < end:
        raise UsageError(f"{path}: node {node} is known from {first:g} to {last:g} s: no time is left between "
                         f"{start:g} and {end:g} s")  # fmt: skip
    inside = track[(track[:, 0] > start) & (track[:, 0] < end)]
    ends = [[time, *(np.interp(time, track[:, 0], track[:, column]) for column in (1, 2, 3))] for time in (start, end)]
    return np.vstack([ends[0], inside, ends[1]])


def _origin(tracks: Mapping[str, Floats], wanted: tuple[float, float] | str | None) -> tuple[float, float]:
    """The place that becomes (0, 0)."""
    if wanted is None:
        return 0.0, 0.0
    if isinstance(wanted, tuple):
        return wanted
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
    high = bool(np.isfinite(track[:, 3]).all())
    cell = io.StringIO()
    csv.writer(cell, lineterminator="").writerow([node])
    name = cell.getvalue()
    rows = [f"time,id,x,y{',z' if high else ''}"]
    for time, x, y, z in track.tolist():
        rows.append(
            ",".join([_digits(time, 9), name, _digits(x, 6), _digits(y, 6), *([_digits(z, 6)] if high else [])])
        )
    return "\n".join(rows) + "\n"


def _digits(value: float, digits: int) -> str:
    """A number with at most this number of decimal places."""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def write_shifted_nodes(source: Path, out: Path, origin: tuple[float, float]) -> None:
    """Write the positions of a file (columns x, y, perhaps id and z) relative to an origin (m).

    Raises:
        RunError: A position cannot be read. The message names file and line.
        StorageError: The file cannot be written.
    """
    read = _positions(source)
    places = read.draw(0.0, np.random.default_rng(0)) - np.array(origin)
    heights = read.heights
    table: dict[str, Sequence[object]] = {"id": read.names}
    table |= {name: [_digits(value, 6) for value in column] for name, column in zip("xy", places.T, strict=True)}
    if heights is not None:
        table["z"] = [_digits(value, 6) for value in heights]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([table.keys(), *zip(*table.values(), strict=True)])
    write_text_atomically(out, text.getvalue())


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
    motions = [f"{{kind: recorded_track, path: {_quoted(path.name)}, time_origin: {_digits(first, 9)}, q: 1}}"
               for path in files.values()]  # fmt: skip
    motion = f"motion: {motions[0]}" if len(motions) == 1 else "targets:\n" + "\n".join(f"  - {m}" for m in motions)
    x, y = placed_tracks.origin
    about = printable(" ".join(source.split()))
    allowed = _quoted(re.sub(r"^\W|[^\w.-]", "_", name, flags=re.ASCII)[:LONGEST_STEM])
    return f"""\
# Trajectories from {about}. The origin of this scenario is the place ({x:.10g}, {y:.10g}) m of that file.
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
