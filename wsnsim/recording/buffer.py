"""A buffer of rows for one table: preallocated columns of one chunk, written when they are full.

A column that fits into a few kilobytes is written in one piece with its description. HDF5 checks both by one checksum,
and such a column needs no chunk index, which takes 2 kB a column. Longer columns are compressed in chunks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, final

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t

from wsnsim.base.tables import Column
from wsnsim.recording.layout import CHUNK, COMPACT, flag_words
from wsnsim.recording.packed_rows import write_packed_rows

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
        fitted = _cast_floats(value, dtype) if array.dtype.kind == "f" else np.asarray(value, dtype=dtype)
        fits = dtype.kind == "f" or bool((fitted == array).all())
    except (OverflowError, ValueError):
        fits = False
    assert fits, f"{name} holds values that do not fit {dtype}"
    return fitted


def _cast_floats(value: Any, dtype: np.dtype[Any]) -> np.ndarray:
    """The cast without a warning about values that do not fit, which the caller checks."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(value, dtype=dtype)


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
