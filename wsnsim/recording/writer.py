"""The recorders that write a result file, or keep the same tables and texts in memory until they are saved.

    with ResultFile(Path("results/x.h5"), [("px", "m"), ("vx", "m/s")], {"truth": True}) as file: ...
    result = MemoryResult([("px", "m"), ("vx", "m/s")], {"truth": True})
    columns, words = result.table("truth")        as `read_with_meanings` of the file
    result.save(Path("x.h5"))

Rows go to NAME.<host>.<pid>-<random>.tmp in the same folder. This file is closed, synchronised and renamed on a clean
exit, and removed on an exception, so that a file with its final name is complete.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, final

import h5py
import numpy as np

from wsnsim.base.errors import ResultError, StorageError, did_you_mean
from wsnsim.base.tables import TABLES, Column, Words, columns_of, equally_long
from wsnsim.base.version import __version__
from wsnsim.recording import rows
from wsnsim.recording.atomic_files import cannot_write, replacing


@final
class ResultFile:
    """A `base.ports.Recorder` that is a context manager.

    Args:
        path: result file.
        states: names and units of the motion model's state.
        wanted: whether a table is kept; rows of other tables are dropped.
        status: status that the file gets when it is closed; until then it is WRITING.
        **layout: `position`, `components`, `duty_cycled` and further conditions, as of `columns_of`.

    Raises:
        StorageError: the file cannot be written (missing folder, full disk, ...). The temporary file is removed.
    """

    def __init__(
        self,
        path: Path,
        states: Sequence[tuple[str, str]],
        wanted: Mapping[str, bool],
        *,
        status: str = rows.COMPLETE,
        **layout: Any,
    ) -> None:
        unknown = wanted.keys() - TABLES.keys()
        assert not unknown, f"unknown tables: {', '.join(sorted(unknown))}"
        self.path = Path(path)
        self.words = Words()
        self.state_names = Words(())
        self._states, self._layout = tuple(states), layout
        self._wanted = tuple(table for table in TABLES if wanted.get(table, False))
        self._status = status
        self._buffers: dict[str, rows.TableBuffer] = {}
        self._provenance: str | None = None
        self._flushed_at = float("-inf")

    def __enter__(self) -> ResultFile:
        if not self.path.parent.is_dir():
            raise StorageError(f"{self.path}: cannot be written: folder does not exist: {self.path.parent}")
        if self.path.is_dir():
            raise StorageError(f"{self.path}: cannot be written: it is a folder")
        with contextlib.ExitStack() as stack:
            self._tmp = stack.enter_context(replacing(self.path, self.path.name.removesuffix(".h5")))
            self._begin(stack)
            self._opened = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            with self._opened:
                self._finish()
            return
        with contextlib.suppress(Exception):  # closing fails on a full disk; the temporary file is removed all the same
            self._opened.__exit__(kind, error, traceback)

    def _close(self, kind: object, *_: object) -> None:
        """Close the HDF5 file. After an error, as of a full disk, closing may fail, too: the first error counts."""
        with contextlib.suppress(OSError, RuntimeError) if kind else contextlib.nullcontext():
            self._file.close()

    def wants(self, table: str) -> bool:
        """Whether the rows of the table are kept."""
        return table in self._wanted

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows to a table: for every column an array or list of one length, or a scalar, which is repeated."""
        assert table in TABLES, f"unknown table: {table}"
        buffer = self._buffers.get(table)
        if buffer is None:
            return
        try:
            if buffer.append(columns):
                self._flush_if_due()
        except (OSError, RuntimeError) as error:
            raise cannot_write(self.path, error) from error

    def set_text(self, name: str, text: str) -> None:
        """Store one of `rows.TEXTS`. The end of the run is added to `provenance_json` when the file is closed."""
        assert name in rows.TEXTS, f"unknown text: {name}"
        if name == "provenance_json":
            self._provenance = text
        try:
            _put_text(self._file, name, text)
        except (OSError, RuntimeError) as error:
            raise cannot_write(self.path, error) from error

    def _begin(self, stack: contextlib.ExitStack) -> None:
        self._in_memory = set(self._wanted) <= set(rows.SHORT_TABLES)  # HDF5 may crash on a full disk
        self._file = _create(self._tmp, self._in_memory)
        stack.push(self._close)
        attributes = self._file.attrs
        attributes["schema_version"] = rows.SCHEMA_VERSION
        attributes["wsnsim_version"] = __version__
        attributes["status"] = rows.WRITING
        attributes["states"] = [name for name, _ in self._states]
        attributes["state_units"] = [unit for _, unit in self._states]
        if self._layout.get("position") is not None:
            attributes["position"] = list(self._layout["position"])
        for table in self._wanted:
            columns = columns_of(table, self._states, **self._layout)
            self._buffers[table] = rows.TableBuffer(self._file.create_group(table), columns)
        self._file.flush()

    def _flush_if_due(self) -> None:
        now = time.monotonic()
        if now - self._flushed_at >= rows.FLUSH_EVERY:
            self._write_words()
            self._file.flush()
            self._flushed_at = now

    def _write_words(self) -> None:
        for name, words in (("events/what", self.words), ("tracker_state/name", self.state_names)):
            if name in self._file:
                rows.write_meanings(self._file[name], words.all())

    def _finish(self) -> None:
        for buffer in self._buffers.values():
            buffer.finish()
        self._write_words()
        if self._provenance is not None and self._status == rows.COMPLETE:
            _put_text(self._file, "provenance_json", with_end(self._provenance))
        self._file.attrs["status"] = self._status
        if self._in_memory:
            self._file.flush()
            self._tmp.write_bytes(self._file.id.get_file_image())


def with_end(provenance: str) -> str:
    """The provenance with the time at which the runs ended: now, unless it says so already."""
    known = json.loads(provenance)
    return json.dumps({**known, "end": known.get("end") or datetime.now(UTC).isoformat(timespec="seconds")})


def _create(tmp: Path, in_memory: bool) -> h5py.File:
    """Create a file that HDF5 1.8 can read, in memory or on disk; its object headers have checksums.

    Metadata are written by a flush only, so that the file of a killed run is that of the last flush. Chunks are written
    at once, so that a full disk is noticed immediately.
    """
    place: dict[str, Any] = {"driver": "core", "backing_store": False} if in_memory else {}
    file = h5py.File(tmp, "w", libver=("v108", "v108"), rdcc_nbytes=0, **place)
    config = file.id.get_mdc_config()
    config.evictions_enabled = False
    config.incr_mode = config.decr_mode = config.flash_incr_mode = 0
    file.id.set_mdc_config(config)
    return file


def _put_text(file: h5py.File, name: str, text: str) -> None:
    if name in file:
        del file[name]
    file.create_dataset(name, data=text, dtype=h5py.string_dtype())


@final
class MemoryResult:
    """A `base.ports.Recorder` that is a context manager, as `ResultFile` is, and keeps tables and texts in memory.

    Args:
        states: names and units of the motion model's state.
        wanted: whether a table is kept; rows of other tables are dropped.
        **layout: as of `ResultFile`.
    """

    def __init__(self, states: Sequence[tuple[str, str]], wanted: Mapping[str, bool], **layout: Any) -> None:
        self.words = Words()
        self.state_names = Words(())
        self._states, self._layout = tuple(states), layout
        self._pieces: dict[str, list[dict[str, np.ndarray]]] = {table: [] for table in TABLES if wanted.get(table)}
        self._columns = {table: columns_of(table, self._states, **layout) for table in self._pieces}
        self._texts: dict[str, str] = {}

    def __enter__(self) -> MemoryResult:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if "provenance_json" in self._texts:
            self._texts["provenance_json"] = with_end(self._texts["provenance_json"])

    @property
    def tables(self) -> tuple[str, ...]:
        """The names of the tables that are kept."""
        return tuple(self._pieces)

    def wants(self, table: str) -> bool:
        """Whether the rows of the table are kept."""
        return table in self._pieces

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows to a table: for every column an array or list of one length, or a scalar, which is repeated."""
        assert table in TABLES, f"unknown table: {table}"
        if table in self._pieces:
            fitted = rows.fitted_rows(table, self._columns[table], columns)
            self._pieces[table].append({name: array.copy() for name, array in equally_long(fitted).items()})

    def set_text(self, name: str, text: str) -> None:
        """Keep one of `rows.TEXTS`."""
        assert name in rows.TEXTS, f"unknown text: {name}"
        self._texts[name] = text

    def table(self, name: str) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
        """(columns of a table, words of its category columns).

        Raises:
            ResultError: the table was not recorded.
        """
        if name not in self._pieces:
            raise ResultError(f"table {name} was not recorded ({did_you_mean(name, self.tables)})")
        columns = self._columns[name]
        return {column.name: self._values(name, column) for column in columns}, {
            column.name: words for column in columns if (words := self._words_of(name, column))
        }

    def save(self, path: Path) -> None:
        """Write the result file.

        Raises:
            StorageError: the file cannot be written.
        """
        with ResultFile(path, self._states, dict.fromkeys(self._pieces, True), **self._layout) as file:
            file.words, file.state_names = self.words, self.state_names
            for name, text in self._texts.items():
                file.set_text(name, text)
            for table, pieces in self._pieces.items():
                for piece in pieces:
                    file.write(table, piece)

    def _values(self, table: str, column: Column) -> np.ndarray:
        pieces = [piece[column.name] for piece in self._pieces[table]]
        return np.concatenate(pieces) if pieces else np.empty(0, column.dtype)

    def _words_of(self, table: str, column: Column) -> tuple[str, ...]:
        registered = {("events", "what"): self.words, ("tracker_state", "name"): self.state_names}.get(
            (table, column.name)
        )
        return rows.flag_words(column.meanings if registered is None else registered.all())
