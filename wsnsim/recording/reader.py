"""A result file as plain NumPy and text.

    read_table(path, table, columns=None, rows=None) -> {column: array};  tables(path);  meanings(path, table, column)
    read_text(path, name);  attributes(path)

Every function raises ResultError, with the file's name and the reason, for a file that is missing, is not one of ours,
is not finished or is damaged, and for a name that it does not hold.
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
from wsnsim.base.tables import TABLES
from wsnsim.recording.layout import SCHEMA_VERSION, TEXTS, WRITING, reason


class TableSize(NamedTuple):
    """How much a table holds: its rows, its columns' names, and the bytes that their values take in the file."""

    rows: int
    columns: tuple[str, ...]
    stored_bytes: int


def read_table(
    path: str | Path, table: str, columns: Sequence[str] | None = None, rows: slice | None = None
) -> dict[str, np.ndarray]:
    """The table's columns, or those asked for, in that order. Categories are their codes, booleans 0 and 1.

    `rows`: only these, of which only the chunks that hold them are read.
    """
    with opened(path) as file:
        group = _group(file, path, table)
        names = column_names(group) if columns is None else columns
        return {name: _column(group, path, name)[... if rows is None else rows] for name in names}


def read_with_meanings(
    path: str | Path, table: str, columns: Sequence[str] | None = None
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """The table's columns as `read_table` gives them, and the words of those that are categories, in one opening."""
    with opened(path) as file:
        group = _group(file, path, table)
        datasets = {name: _column(group, path, name) for name in (column_names(group) if columns is None else columns)}
        words = {name: words_of(dataset) for name, dataset in datasets.items()}
        return {name: dataset[...] for name, dataset in datasets.items()}, {n: w for n, w in words.items() if w}


def tables(path: str | Path) -> dict[str, TableSize]:
    """What tables the file holds, and how much of each. Reads no values."""
    with opened(path) as file:
        return {name: _size(file[name]) for name in TABLES if name in file}


def meanings(path: str | Path, table: str, column: str) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () if the column is none."""
    with opened(path) as file:
        return words_of(_column(_group(file, path, table), path, column))


def read_text(path: str | Path, name: str) -> str:
    """One of the file's texts: `scenario/source_yaml`, `scenario/resolved_json`, `provenance_json`."""
    with opened(path) as file:
        held = text_names(file)
        if name not in held:
            raise ResultError(f"{path}: holds no text '{name}' ({did_you_mean(name, held)})")
        result: str = file[name].asstr()[()]
        return result


def attributes(path: str | Path) -> dict[str, Any]:
    """The root's attributes: status, schema_version, wsnsim_version, `states` (name, unit), `position` (numbers)."""
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
    """The file, open to read, once it is known to be one of ours. Damage found later is a ResultError too."""
    path = Path(path)
    if not path.is_file():
        raise ResultError(
            f"{path}: {'is a folder, not a result' if path.is_dir() else 'no such file' + _nearest(path)}"
        )
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
    """The table's columns in order."""
    return tuple(str(name) for name in group.attrs["columns"])


def words_of(dataset: h5py.Dataset) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () if the column is none."""
    return tuple(str(dataset.attrs.get("flag_meanings", "")).split())


def text_names(file: h5py.File) -> list[str]:
    """Where the file holds texts."""
    return [name for name in TEXTS if name in file]


def states_of(file: h5py.File) -> tuple[tuple[str, str], ...]:
    """(name, unit) of each state column."""
    names, units = file.attrs["states"], file.attrs["state_units"]
    return tuple((str(name), str(unit)) for name, unit in zip(names, units, strict=True))


def position_of(file: h5py.File) -> tuple[int, ...] | None:
    """Which of the state columns are the position; None if the file does not say."""
    return tuple(int(i) for i in file.attrs["position"]) if "position" in file.attrs else None


def _check(file: h5py.File, path: Path, unfinished: bool) -> None:
    found = file.attrs.get("schema_version")
    if found is None or "status" not in file.attrs:
        raise ResultError(f"{path}: is an HDF5 file, but not a wsnsim result")
    if found > SCHEMA_VERSION:
        raise ResultError(f"{path}: was written by a newer wsnsim ({file.attrs.get('wsnsim_version')}): schema {found}")
    if file.attrs["status"] == WRITING and not unfinished:
        raise ResultError(f"{path}: is what an unfinished run left; `wsnsim recover` copies out what it holds")


def _group(file: h5py.File, path: str | Path, table: str) -> h5py.Group:
    held = [name for name in file if name in TABLES]
    if table not in held:
        raise ResultError(f"{path}: holds no table '{table}' ({did_you_mean(table, held)})")
    return file[table]


def _column(group: h5py.Group, path: str | Path, name: str) -> h5py.Dataset:
    held = column_names(group)
    if name not in held:
        raise ResultError(f"{path}: table {group.name[1:]} has no column '{name}' ({did_you_mean(name, held)})")
    return group[name]


def _size(group: h5py.Group) -> TableSize:
    names = column_names(group)
    return TableSize(group[names[0]].shape[0], names, sum(group[name].id.get_storage_size() for name in names))


def _is_hdf5(path: Path) -> bool:
    try:
        return bool(h5py.is_hdf5(path))
    except OSError:
        return False


def _nearest(path: Path) -> str:
    near = difflib.get_close_matches(path.name, [file.name for file in path.parent.glob("*.h5")], n=1)
    return f", did you mean '{path.with_name(near[0])}'?" if near else ""
