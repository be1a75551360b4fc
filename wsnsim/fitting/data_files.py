"""Files of readings, of nodes and of trajectories, read into a `LocatedReadings` with every row checked.

read_sample(files, nodes, form, options) -> LocatedReadings
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import SAME_TIME, Bools, Floats, Ints
from wsnsim.base.errors import RunError, UsageError, did_you_mean, shortened
from wsnsim.base.files import content_digest
from wsnsim.base.initial_conditions import joined_by_name
from wsnsim.fitting.fitted_law import LAWS, LawForm
from wsnsim.fitting.located_readings import DataFile, LocatedReadings, NodeTable
from wsnsim.models.csvfile import Wanted, cells_in, identifiers, open_text, read_rows
from wsnsim.models.recorded_track import recorded_points
from wsnsim.models.row_checks import BadRow, Check, CsvRows, first_of_equal
from wsnsim.models.unit_checks import is_explained, losses, remedy

NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "time": ("time", "t"),
    "node": ("node", "receiver"),
    "reading": ("reading",),
    "id": ("id", "node", "receiver"),
    "target": ("target",),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
}
"""{our name of a column: its usual names in files}; `columns` and `node_columns` can give another."""
COLUMNS: Final = {"columns": set(NAMES) - {"id"}, "node_columns": {"id", "x", "y", "z"}}
"""{option: the columns that it can rename}."""

SMALL_UNITS: Final = {1e-3: "mm", 1e-2: "cm"}
"""{m: the unit} of units in which ranges or places may have been given."""
TENTH: Final = 0.1
"""Part of the spread of a node's distances that residuals are compared with (our choice)."""
REMEDY: Final = "--skip-bad-rows leaves them out and counts them"


@dataclass(frozen=True)
class ReadingOptions:
    """How the files are read.

    Attributes:
        columns: {our name of a column: its name in the files of readings and trajectories}, where it is not one of
            NAMES. A trajectory may have another name of `time` that is.
        node_columns: the same for the file of nodes.
        tracks: files of trajectories with time, x, y and perhaps z: one for all files of readings, or one for each;
            without any, x and y are columns of the readings.
        skip_bad_rows: whether rows that cannot be used are left out and counted, instead of refused.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    tracks: Sequence[str] = ()
    skip_bad_rows: bool = False
    node_columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises UsageError for an unknown column."""
        for option, allowed in COLUMNS.items():
            for name in set(getattr(self, option)) - allowed:
                raise UsageError(f"{option}: unknown column '{name}' ({did_you_mean(name, allowed)})")


_Rows: TypeAlias = tuple[Floats, Ints, Floats, Floats, Ints, DataFile]
"""Times, nodes, readings, points and lines of the usable rows of one file, and the file."""


def read_nodes(path: str, columns: Mapping[str, str]) -> NodeTable:
    """The nodes of a CSV file with the columns id, x, y and perhaps z.

    Raises:
        RunError: the file cannot be used; the message names file and line.
    """
    names = names_in(path, columns, ("reading",))
    wanted = Wanted({"id": names["id"]}, {axis: names[axis] for axis in "xyz"}, ("z",))
    rows = read_rows(path, wanted, "nodes")
    rows = rows.without(rows.nodes_once("id"), skip=False)
    return NodeTable(rows.texts["id"].names, rows.points, path)


def read_sample(files: Sequence[str], nodes: NodeTable, form: LawForm, options: ReadingOptions) -> LocatedReadings:
    """The readings of all files, each a track of its own.

    Raises:
        UsageError: the numbers of files and trajectories do not fit.
        RunError: a file cannot be used; the message names file and line.
    """
    if len(options.tracks) not in (0, 1, len(files)):
        raise UsageError(
            f"{len(options.tracks)} trajectories for {len(files)} files: give one for all, or one for each"
        )
    # one trajectory stands for all files; '' for none
    tracks = list(options.tracks) * (len(files) if len(options.tracks) == 1 else 1) or [""] * len(files)
    read = [_read_file(file, track, nodes, form, options) for file, track in zip(files, tracks, strict=True)]
    numbers = np.concatenate([np.full(len(rows[0]), index) for index, rows in enumerate(read)])
    *columns, found = zip(*read, strict=True)
    times, heard, readings, points, lines = map(np.concatenate, columns)
    order = np.lexsort((times, numbers))
    ordered = times[order], heard[order], readings[order], points[order], numbers[order]
    sample = LocatedReadings(*ordered, nodes, found, lines[order])
    for number, track in enumerate(tracks if form.kind == "range" else ()):
        _demand_metres(sample.of([number]), track)
    return sample


def _demand_metres(sample: LocatedReadings, track: str) -> None:
    """Refuse ranges or places that seem to be in mm or cm. Raises RunError with the command line that converts them.

    Residuals are compared as `wsnsim check` does, each without the median of its node, which a bias explains.
    """
    import pandas as pd

    def loss(reading: float, node: float, point: float) -> float:
        deployment = sample.deployment._replace(places=node * sample.deployment.places)
        scaled = dataclasses.replace(sample, points=point * sample.points, deployment=deployment)
        distances = scaled.distances(sample.has_heights)
        table = pd.DataFrame({"off": reading * sample.readings - distances, "far": distances})
        table -= table.groupby(sample.nodes).transform("median")
        return float(losses(table.off.to_numpy(), TENTH * table.far.std() + 1e-200).mean())

    files = {"readings": sample.files[0].path, "nodes": sample.deployment.path, "track": track or sample.files[0].path}
    tried = [each for f in SMALL_UNITS for each in ((f, 1.0, 1.0), (1.0, f, 1.0), (1.0, 1.0, f), (1.0, f, f))]
    least, factors = min((loss(*each), each) for each in tried)
    if is_explained(least, loss(1.0, 1.0, 1.0)):
        wrong, unit = [name for name, each in zip(files, factors, strict=True) if each < 1.0], SMALL_UNITS[min(factors)]
        how = " and ".join(remedy(files[name], name, f"--unit {unit}") for name in wrong)
        raise RunError(f"{files['readings']}: must be in m, seem to be in {unit}: {' and '.join(wrong)}. Write: {how}")


def _read_file(path: str, track: str, nodes: NodeTable, form: LawForm, options: ReadingOptions) -> _Rows:
    """The usable rows of one file; refuses the others unless they are to be skipped."""
    names = names_in(path, options.columns, ("reading", form.kind, *LAWS))
    axes = "" if track else "xyz"
    wanted = Wanted(
        {"node": names["node"], "target": names["target"]},
        {name: names[name] for name in ("time", "reading", *axes)},
        ("target", "z"),
    )
    rows = read_rows(path, wanted, "readings")
    ids, codes = rows.texts["node"]
    row_nodes = joined_by_name(
        ids, nodes.ids, path, nodes.path,
        lambda: identifiers(path, (names["node"],)) | unread_names(nodes.path, options.node_columns),
    )[codes]  # fmt: skip
    points, located, skipped = _places_of(rows, track, options)
    checks = [*_checks(rows, row_nodes >= 0, nodes, form, located)]
    none = bool(np.any([wrong for wrong, _ in checks], axis=0).all())
    used = rows.without(*checks, skip=options.skip_bad_rows and not none, remedy="" if none else REMEDY)
    if len(targets := used.texts["target"].names if "target" in used.texts else ()) > 1:
        option = f"--where {names['target']}={min(targets)} --out target_{min(targets)}.csv"
        advice = f"give a file for each, such as {remedy(path, 'readings', option)}"
        raise RunError(f"{path}: has readings of {len(targets)} targets: {advice}")
    bad = ((path, used.bad), (track, skipped))
    notes = tuple(f"{name}:{row.line}: {row.reason}" for name, own in bad for row in own)
    file = DataFile(path, digest_of(path), len(used.lines), notes)
    good = np.isin(rows.lines, used.lines)
    return used.numbers["time"], row_nodes[good], used.numbers["reading"], points[good], used.lines, file


def unread_names(nodes: str, columns: Mapping[str, str]) -> dict[str, list[str]]:
    """The cells of the columns of a file of nodes that look like names and are not read as such."""
    return identifiers(nodes, (names_in(nodes, columns, ())["id"],))


def _checks(rows: CsvRows, known: Bools, nodes: NodeTable, form: LawForm, located: Bools) -> Iterator[Check]:
    """Yield which rows cannot be used, and why.

    Args:
        rows: The rows of the file.
        known: (n,) whether there is a node of this name.
        nodes: The nodes.
        form: The form of the law.
        located: (n,) whether the place of the target is known.
    """
    times, readings, (names, codes) = rows.numbers["time"], rows.numbers["reading"], rows.texts["node"]

    @functools.cache
    def unknown(name: str) -> str:
        return f"node '{name}' has no position in {nodes.path} (which has {shortened(', '.join(nodes.ids))})"

    yield ~known, lambda row: unknown(names[codes[row]])
    within = (form.least <= readings) & (readings <= form.greatest)
    allowed = f"{form.reading_unit} must be between {form.least:g} and {form.greatest:g}"
    allowed += "; --law range is for ranges in m, rssi (the default) for levels" * (not within.any())
    origin = "; give both the same --time-origin" * (not located.any())
    yield ~within, lambda row: f"reading {readings[row]:g} {allowed}"
    yield ~located, lambda row: f"the trajectory does not reach {times[row]:.15g} s{origin}"
    targets = rows.texts["target"].codes if "target" in rows.texts else np.zeros_like(codes)
    first = first_of_equal(known & within & located, times, codes, targets)
    yield (
        first != np.arange(len(first)),
        lambda row: (
            f"node '{names[codes[row]]}' has a reading at {times[row]:.15g} s in line {rows.lines[first[row]]} already"
        ),
    )


def _places_of(rows: CsvRows, track: str, options: ReadingOptions) -> tuple[Floats, Bools, tuple[BadRow, ...]]:
    """Places (n, 3) of the target at the readings, whether each is known (n,), and skipped rows of the trajectory.

    Places are interpolated linearly between the rows of a trajectory.
    """
    count = len(rows.lines)
    if not track:
        return rows.points, np.ones(count, dtype=np.bool_), ()
    names = names_in(track, options.columns, (), shared="time")
    wanted = {name: names[name] for name in ("time", "x", "y", "z")}
    times, track_points, bad = recorded_points(track, wanted, options.skip_bad_rows, REMEDY)
    wanted_times = rows.numbers["time"]
    points = np.full((count, 3), np.nan)
    for axis, values in enumerate(track_points.T):
        points[:, axis] = np.interp(wanted_times, times, values)
    return points, (wanted_times >= times[0] - SAME_TIME) & (wanted_times <= times[-1] + SAME_TIME), bad


def names_in(path: str, columns: Mapping[str, str], reading: tuple[str, ...], shared: str = "") -> dict[str, str]:
    """The names of our columns in a file: as `columns` says, else the first of the usual names that it has.

    Args:
        path: The file.
        columns: The names that are given.
        reading: The usual names of the column of readings.
        shared: Our name of a column that another file has as well: the given name may be its alone.
    """
    with open_text(path) as file:
        header = next(cells_in(file), [])
    columns = {ours: name for ours, name in columns.items() if name in header or ours != shared}
    usual = {**NAMES, "reading": reading or NAMES["reading"]}
    return {
        ours: columns.get(ours) or next((name for name in names if name in header), names[0])
        for ours, names in usual.items()
    }


def digest_of(path: str) -> str:
    """The digest of a file that was just read. Raises RunError if it cannot be read again."""
    try:
        return content_digest(path)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}") from error
