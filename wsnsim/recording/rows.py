"""The layout of a result file, which writer and readers share, and the rows of one table on their way into a file.

Attributes of the root: `schema_version`, `wsnsim_version`, `status`, `states` and `state_units` (the columns of the
motion model's state), `position` (the indices of the position among them). Each table is a group with the attribute
`columns` (their order). Each column is a dataset with `units`, `description`, and, for categories, the CF attributes
`flag_values` and `flag_meanings`. `TEXTS` are string datasets.

A buffer holds the columns of one chunk and writes them when they are full. A column that fits into a few kilobytes is
written in one piece with its description. HDF5 checks both by one checksum, and such a column needs no chunk index,
which takes 2 kB a column. Longer columns are compressed in chunks.

A campaign has thousands of files with a few rows of `runs` and `tracks` each. Opening their 60 columns one by one takes
milliseconds a file. Groups of short tables therefore have an attribute `rows`: an array with one record per row, whose
fields are the columns; a category column is an enumeration of its words. The columns hold the same values.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, final

import h5py
import numpy as np
from h5py import h5a, h5d, h5f, h5g, h5p, h5s, h5t

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import TABLES, Column
from wsnsim.base.version import __version__

SCHEMA_VERSION: Final = 2
"""Of results and of manifests of campaigns: another number is another layout, or another meaning of a scenario."""
CHUNK: Final = 65_536
"""Rows of a chunk."""
COMPACT: Final = 2_048
"""Bytes of a column up to which it is stored with its description: the index of its chunks would be as long."""
FLUSH_EVERY: Final = 30.0
"""Seconds between two flushes."""
KINDS: Final = {table: {column.name: np.dtype(column.dtype).kind for column in TABLES[table]} for table in TABLES}
"""Whether the values of a column are signed, unsigned or real: the number of a run or step is never negative."""
TEXTS: Final = ("scenario/source_yaml", "scenario/resolved_json", "provenance_json")
WRITING: Final = "writing"
COMPLETE: Final = "complete"
PARTIAL: Final = "partial"


def flag_words(words: Iterable[str]) -> tuple[str, ...]:
    """The words in the form of CF `flag_meanings`: without spaces, 'none' for an empty word, and distinct."""
    flags: list[str] = []
    for code, word in enumerate(words):
        flag = "_".join(word.split()) or "none"
        flags.append(f"{flag}_{code}" if flag in flags else flag)
    return tuple(flags)


def demand_schema(place: Path, found: int, version: object) -> None:
    """Check the schema version of a result or manifest, written by a version of wsnsim.

    Raises:
        ResultError: An older or newer wsnsim wrote the file.
    """
    if found != SCHEMA_VERSION:
        age = "an older" if found < SCHEMA_VERSION else "a newer"
        raise ResultError(
            f"{place}: was written by {age} wsnsim ({version}), whose files this one ({__version__}) does not read:"
            " use that version, or make the runs again from their scenario"
        )


class DamagedContent(ValueError):
    """Something in a file that no wsnsim writes. The text says what, without the name of the file."""


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


def open_to_read(path: Path) -> h5f.FileID:
    """The file, opened by HDF5 itself; whatever is open in it is closed with it."""
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fclose_degree(h5f.CLOSE_STRONG)
    return h5f.open(os.fsencode(path), h5f.ACC_RDONLY, access)


def read_packed_rows(path: Path, table: str) -> PackedRows | None:
    """The rows of a result file; None if they have to be read in the ordinary way, or cannot be read.

    It does without the classes of h5py, which take longer than HDF5 itself.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # opening a pipe would wait for ever
            return None
        file = open_to_read(path)
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


_TEXT: Final = h5t.py_create(h5py.string_dtype(), logical=True)
_SCALAR: Final = h5s.create(h5s.SCALAR)


@final
class TableBuffer:
    """A buffer of at most one chunk of rows. The file holds whole chunks only until `finish` is called."""

    def __init__(self, group: h5py.Group, columns: tuple[Column, ...]) -> None:
        self._group = group
        self._name = group.name.strip("/")
        self._columns = columns
        self._buffered = {column.name: np.empty(CHUNK, column.dtype) for column in columns}
        self._filled = 0
        self._written = 0
        group.attrs["columns"] = [column.name for column in columns]

    def append(self, rows: Mapping[str, Any]) -> bool:
        """Append rows: arrays or lists of one length, and scalars, which are repeated. True if a chunk was written."""
        fitted = fitted_rows(self._name, self._columns, rows)
        length = _common_length(self._name, fitted)
        before, start = self._written, 0
        while start < length:
            take = min(CHUNK - self._filled, length - start)
            for name, array in fitted.items():
                self._buffered[name][self._filled : self._filled + take] = (
                    array[start : start + take] if array.ndim else array
                )
            self._filled += take
            start += take
            if self._filled == CHUNK:
                self._write_buffered()
        return self._written > before

    def finish(self) -> None:
        """Write the remaining rows; a table without rows gets empty columns."""
        if not self._written:
            write_packed_rows(self._group, self._columns, {n: v[: self._filled] for n, v in self._buffered.items()})
        if self._filled or not self._written:
            self._write_buffered()

    def _write_buffered(self) -> None:
        rows = self._filled
        for column in self._columns:
            values = self._buffered[column.name][:rows]
            if self._written:
                dataset = self._group[column.name]
                dataset.resize((self._written + rows,))
                dataset[self._written :] = values
            else:
                _create(self._group, column, values)
        self._written += rows
        self._filled = 0


def fitted_rows(table: str, columns: tuple[Column, ...], rows: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The values of each column as an array of its type; scalars, which stand for equal values in all rows, as such."""
    wanted = {column.name: np.dtype(column.dtype) for column in columns}
    unknown, missing = rows.keys() - wanted.keys(), wanted.keys() - rows.keys()
    assert not unknown, f"table {table} has no column {', '.join(sorted(unknown))}"
    assert not missing, f"rows of table {table} lack column {', '.join(sorted(missing))}"
    return {name: _fitted(rows[name], dtype, f"{table}.{name}") for name, dtype in wanted.items()}


def _fitted(value: Any, dtype: np.dtype[Any], name: str) -> np.ndarray:
    """The value as an array of the column's type, with equal numbers.

    A list is converted directly, not from the array that NumPy would make of it: that would turn integers beyond 2**63
    into floats.
    """
    array = np.asarray(value)
    assert array.ndim <= 1, f"{name} takes a scalar or a vector, not shape {array.shape}"
    if array.dtype == dtype:
        return array
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # of values that do not fit, which is asserted below
            fitted = np.asarray(value, dtype=dtype)
        fits = dtype.kind == "f" or bool((fitted == array).all())
    except (OverflowError, ValueError):
        fits = False
    assert fits, f"{name} holds values that do not fit {dtype}"
    return fitted


def _common_length(table: str, fitted: Mapping[str, np.ndarray]) -> int:
    lengths = {array.size for array in fitted.values() if array.ndim}
    assert len(lengths) <= 1, f"columns of table {table} differ in length: {sorted(lengths)}"
    return lengths.pop() if lengths else 1


def _create(group: h5py.Group, column: Column, values: np.ndarray) -> None:
    """Create a dataset with its first rows. Its chunk has as many rows: a longer one costs kilobytes for 30 rows.

    The calls of HDF5 itself take a quarter of the time of h5py's, and a file has a hundred columns.
    """
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    most = values.shape
    if 0 < values.nbytes <= COMPACT and values.size < CHUNK:
        properties.set_layout(h5d.COMPACT)
    elif values.size:
        most = (h5s.UNLIMITED,)
        properties.set_chunk(values.shape)
        if column.smooth:
            properties.set_shuffle()
        properties.set_deflate(1)
    kind, space = h5t.py_create(values.dtype, logical=True), h5s.create_simple(values.shape, most)
    dataset = h5d.create(group.id, column.name.encode(), kind, space, dcpl=properties)
    dataset.write(h5s.ALL, h5s.ALL, values)
    _write_text(dataset, b"units", column.units)
    _write_text(dataset, b"description", column.description)
    if column.meanings:
        write_meanings(h5py.Dataset(dataset), column.meanings)


def _write_text(dataset: h5d.DatasetID, name: bytes, text: str) -> None:
    """Write a new attribute."""
    h5a.create(dataset, name, _TEXT, _SCALAR).write(np.array(text, dtype=h5py.string_dtype()))


def write_meanings(dataset: h5py.Dataset, words: tuple[str, ...]) -> None:
    """Write the CF flags of a category column: value i means word i."""
    dataset.attrs["flag_values"] = np.arange(len(words), dtype=dataset.dtype)
    dataset.attrs["flag_meanings"] = " ".join(flag_words(words))
