"""The rows of a short table in one piece, so that thousands of files can be read quickly.

A campaign has thousands of files with a few rows of `runs` and `tracks` each. Opening their 60 columns one by one takes
milliseconds a file. Groups of short tables therefore have an attribute `rows`: an array with one record per row, whose
fields are the columns; a category column is an enumeration of its words. The columns hold the same values.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import h5py
import numpy as np
from h5py import h5a, h5f, h5g, h5p, h5t

from wsnsim.base.tables import Column
from wsnsim.recording.layout import KINDS, SCHEMA_VERSION, flag_words
from wsnsim.recording.object_headers import DamagedContent

ROWS: Final = "rows"
SHORT_TABLES: Final = ("runs", "tracks")
"""Tables with one row per run or track."""
MOST: Final = 16_384
"""Bytes up to which the rows of a table are packed."""


class PackedRows(NamedTuple):
    """The rows of a short table: (n,) records by column, and the words of the category columns."""

    records: np.ndarray
    words: Mapping[str, tuple[str, ...]]


def write_packed_rows(group: h5py.Group, columns: Sequence[Column], values: Mapping[str, np.ndarray]) -> None:
    """Write the attribute, if the table is a short one and has rows but not many."""
    dtype = np.dtype([(column.name, _stored_type(column)) for column in columns])
    rows = len(values[columns[0].name])
    if group.name.strip("/") not in SHORT_TABLES or not 0 < rows * dtype.itemsize <= MOST:
        return
    records = np.empty(rows, dtype)
    for name, column in values.items():
        records[name] = column
    group.attrs.create(ROWS, records, dtype=dtype)


def read_packed_rows(path: Path, table: str) -> PackedRows | None:
    """The rows of a result file; None if they have to be read in the ordinary way, or cannot be read.

    It does without the classes of h5py, which take longer than HDF5 itself.
    """
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fclose_degree(h5f.CLOSE_STRONG)
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # opening a pipe would wait for ever
            return None
        file = h5f.open(os.fsencode(path), h5f.ACC_RDONLY, access)
    except (OSError, RuntimeError):
        return None
    try:
        version = np.empty((), np.int64)
        h5a.open(file, b"schema_version").read(version)
        name = table.encode()
        if version != SCHEMA_VERSION or h5g.get_objinfo(file, name, follow_link=False).type != h5g.GROUP:
            return None
        return packed_rows(h5g.open(file, name), table)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError):
        return None
    finally:
        file.close()


def packed_rows(group: h5g.GroupID, table: str) -> PackedRows | None:
    """The rows of a table from its attribute; None if it has none, as a long one.

    Raises:
        DamagedContent: the attribute is larger or of another type than wsnsim writes.
    """
    if not h5a.exists(group, ROWS.encode()):
        return None
    attribute = h5a.open(group, ROWS.encode())
    shape = attribute.shape
    if shape is None or len(shape) != 1 or attribute.get_storage_size() > MOST:
        raise DamagedContent(f"the rows of {table} in one piece are larger than wsnsim writes them")
    stored, dtype, words = _known_type(attribute.get_type(), table)
    records = np.empty(shape, dtype)
    attribute.read(records, stored)
    return PackedRows(records, words)


_KNOWN: Final[list[tuple[h5t.TypeID, np.dtype, dict[str, tuple[str, ...]], str]]] = []
"""The last types of records that were read. Translating one takes longer than reading its rows."""


def _known_type(stored: h5t.TypeID, table: str) -> tuple[h5t.TypeID, np.dtype, dict[str, tuple[str, ...]]]:
    """The type, its NumPy type, and the words of its categories."""
    for known in _KNOWN:
        if known[3] == table and known[0].equal(stored):
            return known[:3]
    if stored.get_class() != h5t.COMPOUND or stored.get_size() > MOST:
        raise DamagedContent("rows in one piece are no records")
    translated = stored.dtype
    codes = {name: h5py.check_enum_dtype(translated[name]) for name in translated.names}
    words = {name: tuple(sorted(known, key=known.__getitem__)) for name, known in codes.items() if known}
    plain = np.dtype([(name, translated[name].str) for name in translated.names])
    if plain.itemsize != translated.itemsize or any(plain[name].kind not in "iuf" for name in plain.names or ()):
        raise DamagedContent("rows in one piece have gaps, or hold something else than numbers")
    if any(plain[name].kind != KINDS[table].get(name, plain[name].kind) for name in plain.names or ()):
        raise DamagedContent(f"the rows of {table} in one piece are of another type than wsnsim writes")
    _KNOWN.insert(0, (stored, plain, words, table))
    del _KNOWN[4:]
    return stored, plain, words


def _stored_type(column: Column) -> np.dtype:
    if not column.meanings:
        return np.dtype(column.dtype)
    codes = {word: code for code, word in enumerate(flag_words(column.meanings))}
    stored: np.dtype[Any] = h5py.enum_dtype(codes, column.dtype)
    return stored
