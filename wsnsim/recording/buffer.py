"""Rows on their way to one table: preallocated columns of one chunk, written whole as they fill.

TableBuffer(group, columns).append({name: array, list or scalar}) -> whether a chunk was written;  .finish()
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import h5py
import numpy as np

from wsnsim.base.tables import Column
from wsnsim.recording.layout import CHUNK, flag_words


@final
class TableBuffer:
    """At most one chunk of rows in memory; what is in the file is whole chunks until `finish`."""

    def __init__(self, group: h5py.Group, columns: tuple[Column, ...]) -> None:
        self._group = group
        self._name = group.name.strip("/")
        self._columns = columns
        self._held = {column.name: np.empty(CHUNK, column.dtype) for column in columns}
        self._filled = 0
        self._written = 0
        group.attrs["columns"] = [column.name for column in columns]

    def append(self, rows: Mapping[str, Any]) -> bool:
        """Take rows: arrays or lists of one length, scalars repeated to it. True if a whole chunk went to the file."""
        fitted = self._fit(rows)
        length = _common_length(self._name, fitted)
        before, start = self._written, 0
        while start < length:
            take = min(CHUNK - self._filled, length - start)
            for name, array in fitted.items():
                self._held[name][self._filled : self._filled + take] = (
                    array[start : start + take] if array.ndim else array
                )
            self._filled += take
            start += take
            if self._filled == CHUNK:
                self._write_held()
        return self._written > before

    def finish(self) -> None:
        """Write the rows that did not fill a chunk; a table without rows gets empty columns."""
        if self._filled or not self._written:
            self._write_held()

    def _fit(self, rows: Mapping[str, Any]) -> dict[str, np.ndarray]:
        strange, missing = rows.keys() - self._held.keys(), self._held.keys() - rows.keys()
        assert not strange, f"table {self._name} has no column {', '.join(sorted(strange))}"
        assert not missing, f"rows of table {self._name} lack the column {', '.join(sorted(missing))}"
        return {name: _fitted(rows[name], held.dtype, f"{self._name}.{name}") for name, held in self._held.items()}

    def _write_held(self) -> None:
        rows = self._filled
        for column in self._columns:
            values = self._held[column.name][:rows]
            if self._written:
                dataset = self._group[column.name]
                dataset.resize((self._written + rows,))
                dataset[self._written :] = values
            else:
                _create(self._group, column, values)
        self._written += rows
        self._filled = 0


def _fitted(value: Any, dtype: np.dtype[Any], name: str) -> np.ndarray:
    """The value as an array of the column's type, the same numbers.

    A list is converted from itself, not by way of the type that NumPy guesses: integers beyond 2**63 would pass
    through float.
    """
    array = np.asarray(value)
    assert array.ndim <= 1, f"{name} takes a scalar or one dimension, not shape {array.shape}"
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
    """Without a warning about what does not fit: the caller compares."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(value, dtype=dtype)


def _common_length(table: str, fitted: Mapping[str, np.ndarray]) -> int:
    lengths = {array.size for array in fitted.values() if array.ndim}
    assert len(lengths) <= 1, f"columns written to {table} differ in length: {sorted(lengths)}"
    return lengths.pop() if lengths else 1


def _create(group: h5py.Group, column: Column, values: np.ndarray) -> None:
    """A dataset with its first rows. A short column is one short chunk: a long one would cost kilobytes for 30 rows."""
    layout: dict[str, Any] = {}
    if values.size:
        layout = {
            "chunks": values.shape,
            "maxshape": (None,),
            "compression": "gzip",
            "compression_opts": 1,
            "shuffle": column.smooth,
        }
    dataset = group.create_dataset(column.name, data=values, **layout)
    dataset.attrs["units"] = column.units
    dataset.attrs["description"] = column.description
    if column.meanings:
        write_meanings(dataset, column.meanings)


def write_meanings(dataset: h5py.Dataset, words: tuple[str, ...]) -> None:
    """Give a category column its CF flags: value i means word i."""
    dataset.attrs["flag_values"] = np.arange(len(words), dtype=dataset.dtype)
    dataset.attrs["flag_meanings"] = " ".join(flag_words(words))
