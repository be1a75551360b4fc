"""The port of recorders, one that keeps the rows of a run in memory, and category columns that grow at run time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import numpy as np

from wsnsim.base.table_columns import RECORDED_BY_DEFAULT


class Words:
    """The words of a category column that grows at run time, with their codes; at most 256.

    Args:
        words: The words that have a code from the start.
    """

    def __init__(self, words: Iterable[str] = ("",)) -> None:
        self._codes = {word: code for code, word in enumerate(words)}

    def code(self, word: str) -> int:
        """The code of a word; a new word gets the next one."""
        code = self._codes.setdefault(word, len(self._codes))
        assert code < 256, f"more than 256 different words in a category column, the last being {word!r}"
        return code

    def all(self) -> tuple[str, ...]:
        """All words in the order of their codes."""
        return tuple(self._codes)


class Recorder(Protocol):
    """The destination of the rows of the tables. Columns are those of the tables of a result, with `replicate`.

    Two category columns get new values at run time: `words` holds the codes of `events.what`, `state_names` those of
    `tracker_state.name` (used only where that table is wanted).
    """

    words: Words
    state_names: Words

    def wants(self, table: str) -> bool:
        """Whether a table is recorded."""

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows; a scalar stands for equal values in all rows."""


class Memory:
    """A recorder that keeps all rows in memory, for notebooks and tests: `memory.table('estimates')['error']`.

    Args:
        wanted: {table: whether it is recorded}; by default the tables that scenarios record by default.
    """

    def __init__(self, wanted: Mapping[str, bool] | None = None) -> None:
        self._wanted = dict(RECORDED_BY_DEFAULT if wanted is None else wanted)
        self._pieces: dict[str, list[Mapping[str, Any]]] = {}
        self.words = Words()
        self.state_names = Words(())

    def wants(self, table: str) -> bool:
        """Whether a table is recorded."""
        return self._wanted.get(table, False)

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows; a scalar stands for equal values in all rows."""
        self._pieces.setdefault(table, []).append(columns)

    def table(self, name: str) -> dict[str, np.ndarray]:
        """{column: (rows,)} of all rows of a table that were written so far; empty if there are none."""
        pieces = [equally_long(piece) for piece in self._pieces.get(name, [])]
        return {key: np.concatenate([piece[key] for piece in pieces]) for key in (pieces[0] if pieces else ())}


def equally_long(columns: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The columns of one `write` as arrays of equal length; scalars are repeated."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(values) for values in columns.values()))
    return dict(zip(columns, arrays, strict=True))
