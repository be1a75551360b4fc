"""The results of single files and of a campaign as one DataFrame, with the settings of points as columns.

read_file(path, table, columns=None) -> DataFrame        stacked(files, frames, table) -> DataFrame
read(folder, table, columns=None) -> DataFrame          as `wsnsim.read` of a folder
metric(folder, point, name, replicates) -> values of a metric, and which runs are on disk
ever_lost(runs) -> whether each run lost a track at any time
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from pandas.api.types import union_categoricals

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import ResultError
from wsnsim.base.runs import tracked
from wsnsim.base.tables import DUTY_CYCLED, LATE, RECORDED_BY_DEFAULT, TABLES, WITHOUT_HEAD
from wsnsim.recording import read_with_meanings, tables
from wsnsim.recording.folder import Folder, PointOnDisk
from wsnsim.recording.kept import read_consolidated
from wsnsim.recording.rows import SHORT_TABLES

SOME_HAVE: Final = {*DUTY_CYCLED, *LATE, *WITHOUT_HEAD}
"""Columns of some points of a campaign: of those with radios that sleep, late readings that are used, or no head."""


def read_file(path: str | Path, table: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """A table of one result file."""
    return data_frame(*read_with_meanings(path, table, columns))


def data_frame(columns: Mapping[str, np.ndarray], words: Mapping[str, tuple[str, ...]]) -> pd.DataFrame:
    """The columns as a frame, those with words as Categoricals."""
    return pd.DataFrame({name: _series(values, words.get(name, ())) for name, values in columns.items()})


def stacked(files: Sequence[Path], frames: Sequence[pd.DataFrame], table: str) -> pd.DataFrame:
    """The rows of several files in one frame, with NaN in columns of `SOME_HAVE` that others lack.

    Raises ResultError if the files differ in other columns.
    """
    frames = _padded(frames)
    for file, frame in zip(files, frames, strict=True):
        if list(frame) != list(frames[0]):
            raise ResultError(f"{file}: table {table} has other columns than in {files[0]}; name the columns to read")
    return pd.DataFrame({name: _joined([frame[name] for frame in frames]) for name in frames[0]})


def _padded(frames: Sequence[pd.DataFrame]) -> list[pd.DataFrame]:
    """The frames; those without columns of `SOME_HAVE` get them where another has them."""
    widest = max(frames, key=lambda frame: len(frame.columns))
    return [
        frame.reindex(columns=widest.columns)
        if frame.columns.size < widest.columns.size and {*widest} - {*frame} <= SOME_HAVE and {*frame} <= {*widest}
        else frame
        for frame in frames
    ]


def _series(values: np.ndarray, words: tuple[str, ...]) -> Any:
    """The column, with codes as words. A code without a word is 'unknown_' and its number."""
    if not words:
        return values
    unknown = range(len(words), int(values.max(initial=0)) + 1)
    return pd.Categorical.from_codes(values, [*words, *(f"unknown_{code}" for code in unknown)])


def _joined(pieces: list[pd.Series]) -> Any:
    """Concatenated columns. Categories with different codes are united by their words.

    A file without rows of a table may have no categories for it.
    """
    categories = [piece for piece in pieces if isinstance(piece.dtype, pd.CategoricalDtype)]
    if categories:
        return union_categoricals(categories)
    return np.concatenate([piece.to_numpy() for piece in pieces])


POINT = "point"


def read(
    path: str | Path, table: str, columns: Sequence[str] | None = None, may_lack: Sequence[str] = ()
) -> pd.DataFrame:
    """A table of a campaign, in the order of points, runs and recorded rows.

    The first columns are `point` (its number in the manifest) and one for each swept parameter, named by its key, in SI
    units and its own type (integer, float, boolean or text), missing for points without it. A key that is also a column
    of the table, such as `step`, is named `set.step`.

    Args:
        path: the folder of the campaign.
        table: name of the table.
        columns: the columns to read; None for all.
        may_lack: those of them that a file may lack, which then are NaN.

    Raises:
        ResultError: there is no campaign or no result, or a file cannot be read.
    """
    folder = Folder(path)
    manifest = folder.manifest()
    owned = [
        (number, batch.path)
        for number, point in enumerate(manifest.points)
        for batch in folder.batches(point.id)
        if batch.first < point.replicates
    ]
    if not owned:
        raise ResultError(f"{folder.path}: holds no results yet")
    wanted = None if columns is None else list(dict.fromkeys(["replicate", *columns]))
    together, counts = _rows(folder, [path for _, path in owned], table, wanted, may_lack)
    files = np.repeat(np.arange(len(owned)), counts)
    owners = np.array([number for number, _ in owned], dtype=np.int64)[files]
    chosen = _chosen(manifest.points, owners, together["replicate"].to_numpy().astype(np.int64), files)
    together, owners = together.iloc[chosen].reset_index(drop=True), owners[chosen]
    if columns is not None:
        together = together[list(columns)]
    taken = {column.name for column in TABLES[table]}
    front = {POINT: owners} | {
        key if key not in taken else f"set.{key}": _typed(
            [point.settings.get(key) for point in manifest.points], owners
        )
        for key in manifest.keys
    }
    return pd.concat([pd.DataFrame(front), together], axis=1)


def _rows(
    folder: Folder, files: Sequence[Path], table: str, columns: Sequence[str] | None, may_lack: Sequence[str]
) -> tuple[pd.DataFrame, Ints]:
    """The rows of all files, and the number of those of each file."""
    if table in SHORT_TABLES:
        with _hinted(table):
            found = read_consolidated(folder.path, table, files)
        if found is not None and set(columns or ()) <= {*(held := found[0].records.dtype.names or ())}:
            (records, words), counts = found
            return data_frame({name: records[name].copy() for name in columns or held}, words), counts
    frames = [_of_file(file, table, columns, may_lack) for file in tracked(files, f"files read, table {table}")]
    return stacked(files, frames, table), np.array([len(frame) for frame in frames])


def _chosen(points: Sequence[PointOnDisk], owners: Ints, replicates: Ints, files: Ints) -> Ints:
    """The rows that belong to the campaign, each run from one file only, in the order of points, runs and rows."""
    most = np.array([point.replicates for point in points])
    rows = pd.DataFrame({"owner": owners, "replicate": replicates, "file": files})[replicates < most[owners]]
    rows = rows.sort_values(["owner", "replicate"], kind="stable")
    first = rows.groupby(["owner", "replicate"], sort=False)["file"].transform("first")
    return np.asarray(rows.index[rows["file"] == first], dtype=np.int64)


def metric(folder: Folder, point: str, name: str, replicates: int) -> tuple[Floats, Bools]:
    """A column of `runs` at one point, (replicates,), and whether each run is on disk, (replicates,)."""
    values, seen = np.full(replicates, np.nan), np.zeros(replicates, dtype=np.bool_)
    for batch in folder.batches(point):
        rows, _ = read_with_meanings(batch.path, "runs", ["replicate", name])
        here = rows["replicate"] < replicates
        values[rows["replicate"][here]] = rows[name][here]
        seen[rows["replicate"][here]] = True
    return values, seen


def ever_lost(runs: pd.DataFrame) -> Bools:
    """(runs,) whether a track was lost at any time, of rows of the table `runs`."""
    return np.asarray(runs["losses"].to_numpy() > 0)


def _of_file(path: Path, table: str, columns: Sequence[str] | None, may_lack: Sequence[str]) -> pd.DataFrame:
    with _hinted(table):
        held = tables(path).get(table) if may_lack else None
        if columns is None or held is None:
            return read_file(path, table, columns)
        known = [name for name in columns if name in held.columns or name not in may_lack]
        return read_file(path, table, known).reindex(columns=list(columns))


@contextlib.contextmanager
def _hinted(table: str) -> Iterator[None]:
    """Add how a campaign records a table to the error that a file does not have it."""
    try:
        yield
    except ResultError as error:
        if table in RECORDED_BY_DEFAULT and f"no table '{table}'" in str(error):
            hint = f"a campaign records it with record.{table}=true in its sweep or by --set"
            raise ResultError(f"{error}: {hint}") from None
        raise


def _typed(values: Sequence[Any], owners: np.ndarray) -> Any:
    """The setting of each row's point, as a column of the values' common type."""
    dtype = _type_of(values)
    if isinstance(dtype, pd.CategoricalDtype):
        values = [None if value is None else str(value) for value in values]
    return pd.Series(list(values), dtype=dtype).iloc[owners].reset_index(drop=True)


def _type_of(values: Sequence[Any]) -> Any:
    known = [value for value in values if value is not None]
    kind, complete = pd.api.types.infer_dtype(known, skipna=False), len(known) == len(values)
    if kind == "boolean":
        return "bool" if complete else "boolean"
    if kind == "integer":
        width = pd.Series(known).dtype.name
        return width if complete else "Int64" if width == "int64" else "object"
    if kind in ("floating", "mixed-integer-float", "integer-na"):
        return "float64"
    return pd.CategoricalDtype(list(dict.fromkeys(str(value) for value in known)))
