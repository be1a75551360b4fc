"""Readers of a result file, which give NumPy arrays and text.

Every function raises ResultError, with the file's name and the reason, if the file does not exist, is not a wsnsim
result, is unfinished or damaged, or does not contain what is asked for.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from wsnsim.base.errors import ResultError, did_you_mean
from wsnsim.base.regular_files import why_not_regular
from wsnsim.base.tables import TABLES
from wsnsim.recording.layout import SCHEMA_VERSION, TEXTS, WRITING, reason
from wsnsim.recording.packed_rows import PackedRows, packed_rows


class TableSize(NamedTuple):
    """Size of a table: number of rows, names of the columns, and bytes of the values in the file."""

    rows: int
    columns: tuple[str, ...]
    stored_bytes: int


def read_table(
    path: str | Path, table: str, columns: Sequence[str] | None = None, rows: slice | None = None
) -> dict[str, np.ndarray]:
    """The columns of a table; categories as codes, booleans as 0 and 1.

    Args:
        path: result file.
        table: name of the table.
        columns: columns to read, in this order; all by default.
        rows: rows to read; only their chunks are read.
    """
    with opened(path) as file:
        group = _group(file, path, table)
        names = column_names(group) if columns is None else columns
        return {name: _column(group, path, name)[... if rows is None else rows] for name in names}


def read_with_meanings(
    path: str | Path, table: str, columns: Sequence[str] | None = None
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """(columns as from `read_table`, words of the category columns); the file is opened once.

    The rows of short tables are read in one piece, see `packed_rows`.
    """
    with opened(path) as file:
        group = _group(file, path, table)
        if (packed := packed_rows(group.id)) is not None:
            return _unpacked(packed, columns, group, path)
        datasets = {name: _column(group, path, name) for name in (column_names(group) if columns is None else columns)}
        words = {name: words_of(dataset) for name, dataset in datasets.items()}
        return {name: dataset[...] for name, dataset in datasets.items()}, {n: w for n, w in words.items() if w}


def tables(path: str | Path) -> dict[str, TableSize]:
    """The tables in the file and their sizes. No values are read."""
    with opened(path) as file:
        return {name: _size(file[name]) for name in TABLES if name in file}


def row_count(path: str | Path, table: str) -> int:
    """The number of rows of a table."""
    with opened(path) as file:
        group = _group(file, path, table)
        return int(_dataset(group, column_names(group)[0]).shape[0])


def table_names(path: str | Path) -> list[str]:
    """The names of the tables in the file."""
    with opened(path) as file:
        return [name for name in TABLES if name in file]


def meanings(path: str | Path, table: str, column: str) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () for other columns."""
    with opened(path) as file:
        return words_of(_column(_group(file, path, table), path, column))


def all_meanings(path: str | Path, table: str) -> dict[str, tuple[str, ...]]:
    """{column: the words of a category column, in the order of its codes; () for other columns} of a table."""
    with opened(path) as file:
        group = _group(file, path, table)
        return {name: words_of(_dataset(group, name)) for name in column_names(group)}


def read_text(path: str | Path, name: str) -> str:
    """One of the texts `scenario/source_yaml`, `scenario/resolved_json` and `provenance_json`."""
    with opened(path) as file:
        held = text_names(file)
        if name not in held:
            raise ResultError(f"{path}: has no text '{name}' ({did_you_mean(name, held)})")
        return str(file[name].asstr()[()])


def attributes(path: str | Path) -> dict[str, Any]:
    """The root's attributes: status, schema_version, wsnsim_version, states (name, unit) and position (indices)."""
    with opened(path) as file:
        root = file.attrs
        return {
            "status": str(root["status"]),
            "schema_version": int(root["schema_version"]),
            "wsnsim_version": str(root["wsnsim_version"]),
            "states": states_of(file),
            "position": position_of(file),
        }


@contextmanager
def opened(path: str | Path, unfinished: bool = False) -> Iterator[h5py.File]:
    """Open a result for reading, checked to be one. Damage that is found later also raises ResultError."""
    path = Path(path)
    if not path.is_file():
        irregular = "is a folder, not a result" if path.is_dir() else why_not_regular(path)
        raise ResultError(f"{path}: {irregular or 'no such file' + _nearest(path)}")
    try:
        with h5py.File(path, "r") as file:
            _check(file, path, unfinished)
            yield file
    except BlockingIOError as error:
        raise ResultError(f"{path}: is still being written") from error
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        what = "cannot be read" if _is_hdf5(path) else "is not a wsnsim result"
        raise ResultError(f"{path}: {what}: {reason(error)}") from error


def column_names(group: h5py.Group) -> tuple[str, ...]:
    """The names of a table's columns, in order."""
    return tuple(str(name) for name in group.attrs["columns"])


def words_of(dataset: h5py.Dataset) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () for other columns."""
    return tuple(str(dataset.attrs.get("flag_meanings", "")).split())


def text_names(file: h5py.File) -> list[str]:
    """The names of the texts in the file."""
    return [name for name in TEXTS if name in file]


def states_of(file: h5py.File) -> tuple[tuple[str, str], ...]:
    """(name, unit) of each state column."""
    names, units = file.attrs["states"], file.attrs["state_units"]
    return tuple((str(name), str(unit)) for name, unit in zip(names, units, strict=True))


def position_of(file: h5py.File) -> tuple[int, ...] | None:
    """The indices of the position among the state columns, None if the file does not say."""
    return tuple(int(i) for i in file.attrs["position"]) if "position" in file.attrs else None


def _check(file: h5py.File, path: Path, unfinished: bool) -> None:
    found = file.attrs.get("schema_version")
    if found is None or "status" not in file.attrs:
        raise ResultError(f"{path}: is an HDF5 file, but not a wsnsim result")
    if found > SCHEMA_VERSION:
        raise ResultError(f"{path}: was written by a newer wsnsim ({file.attrs.get('wsnsim_version')}): schema {found}")
    if file.attrs["status"] == WRITING and not unfinished:
        raise ResultError(f"{path}: is the file of an unfinished run; `wsnsim recover` recovers its rows")


def _group(file: h5py.File, path: str | Path, table: str) -> h5py.Group:
    if table not in TABLES or table not in file:
        held = [name for name in file if name in TABLES]
        raise ResultError(f"{path}: has no table '{table}' ({did_you_mean(table, held)})")
    return file[table]


def _column(group: h5py.Group, path: str | Path, name: str) -> h5py.Dataset:
    return _dataset(group, _checked(name, group, path))


def _dataset(group: h5py.Group, name: str) -> h5py.Dataset:
    """A column of the table. `group[name]` takes three times as long, and most tables are short."""
    return h5py.Dataset(h5py.h5d.open(group.id, name.encode()), readonly=True)


def _unpacked(
    packed: PackedRows, columns: Sequence[str] | None, group: h5py.Group, path: str | Path
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """(columns, words) of packed rows."""
    held = packed.records.dtype.names or ()
    names = held if columns is None else [name if name in held else _checked(name, group, path) for name in columns]
    found = {name: np.ascontiguousarray(packed.records[name]) for name in names}
    return found, {name: words for name, words in packed.words.items() if name in found}


def _checked(name: str, group: h5py.Group, path: str | Path) -> str:
    """The name of a column that the table has. Raises ResultError."""
    if name not in group:
        held = column_names(group)
        raise ResultError(f"{path}: table {group.name[1:]} has no column '{name}' ({did_you_mean(name, held)})")
    return name


def _size(group: h5py.Group) -> TableSize:
    names = column_names(group)
    opened = [h5py.h5d.open(group.id, name.encode()) for name in names]
    return TableSize(opened[0].shape[0], names, sum(each.get_storage_size() for each in opened))


def _is_hdf5(path: Path) -> bool:
    try:
        return bool(h5py.is_hdf5(path))
    except OSError:
        return False


def _nearest(path: Path) -> str:
    near = difflib.get_close_matches(path.name, [file.name for file in path.parent.glob("*.h5")], n=1)
    return f", did you mean '{path.with_name(near[0])}'?" if near else ""
