"""The recorder that keeps a result in memory: the same tables and texts as a file, which `save` writes.

result = MemoryResult([("px", "m"), ("vx", "m/s")], {"truth": True})
columns, words = result.table("truth")        as `read_with_meanings` of the file
result.save(Path("x.h5"))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, final

import numpy as np

from wsnsim.base.errors import ResultError, did_you_mean
from wsnsim.base.tables import TABLES, Column, Words, columns_of, equally_long
from wsnsim.recording.buffer import fitted_rows
from wsnsim.recording.layout import TEXTS, flag_words
from wsnsim.recording.writer import ResultFile, with_end


@final
class MemoryResult:
    """A `base.ports.Recorder` that is a context manager, as `ResultFile` is, and keeps what that would write.

    Args:
        states: names and units of the motion model's state.
        wanted: whether a table is kept; rows of other tables are dropped.
        position: indices of the position in the state.
        components: number of components of a reading.
        duty_cycled: whether a MAC switches radios off.
    """

    def __init__(
        self,
        states: Sequence[tuple[str, str]],
        wanted: Mapping[str, bool],
        *,
        position: Sequence[int] | None = None,
        components: int = 1,
        duty_cycled: bool = False,
    ) -> None:
        self.words = Words()
        self.state_names = Words(())
        self._states = tuple(states)
        self._position = None if position is None else tuple(position)
        self._components = components
        self._duty_cycled = duty_cycled
        self._pieces: dict[str, list[dict[str, np.ndarray]]] = {table: [] for table in TABLES if wanted.get(table)}
        self._columns = {table: self._columns_of(table) for table in self._pieces}
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
            fitted = fitted_rows(table, self._columns[table], columns)
            self._pieces[table].append({name: array.copy() for name, array in equally_long(fitted).items()})

    def set_text(self, name: str, text: str) -> None:
        """Keep one of `layout.TEXTS`."""
        assert name in TEXTS, f"unknown text: {name}"
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
        with ResultFile(
            path,
            self._states,
            dict.fromkeys(self._pieces, True),
            position=self._position,
            components=self._components,
            duty_cycled=self._duty_cycled,
        ) as file:
            file.words, file.state_names = self.words, self.state_names
            for name, text in self._texts.items():
                file.set_text(name, text)
            for table, pieces in self._pieces.items():
                for piece in pieces:
                    file.write(table, piece)

    def _columns_of(self, table: str) -> tuple[Column, ...]:
        return columns_of(table, self._states, self._position, self._components, self._duty_cycled)

    def _values(self, table: str, column: Column) -> np.ndarray:
        pieces = [piece[column.name] for piece in self._pieces[table]]
        return np.concatenate(pieces) if pieces else np.empty(0, column.dtype)

    def _words_of(self, table: str, column: Column) -> tuple[str, ...]:
        grown = {("events", "what"): self.words, ("tracker_state", "name"): self.state_names}.get((table, column.name))
        return flag_words(column.meanings if grown is None else grown.all())
