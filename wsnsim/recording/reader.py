"""Functions that read a result file into NumPy arrays and text.

Every function raises ResultError, with the file's name and the reason, if the file does not exist, is not a wsnsim
result, is unfinished or damaged, or does not contain what is asked for. A stored JSON text raises it too, if a key is
missing or of another type.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, final

import numpy as np
from h5py import h5g

from wsnsim.base.errors import ResultError, did_you_mean, nearest
from wsnsim.base.files import why_not_regular
from wsnsim.base.tables import TABLES
from wsnsim.recording.atomic_files import reason
from wsnsim.recording.contents import Content, name_of
from wsnsim.recording.object_headers import StoredColumn
from wsnsim.recording.rows import (
    KINDS,
    TEXTS,
    WRITING,
    DamagedContent,
    PackedRows,
    demand_schema,
    open_to_read,
    packed_rows,
)

NUMBER: Final = (int, float)
TYPES: Final[dict[str, tuple[type, ...]]] = {
    "name": (str,), "seed": (int,), "replicates": (int,), "step": NUMBER, "duration": NUMBER,
    "command_line": (str,), "python": (str,), "packages": (dict,), "git": (dict, type(None)), "commit": (str,),
    "dirty": (bool,), "platform": (str,), "cpu_features": (list,), "plugins": (list,), "start": (str,), "end": (str,),
    "engine": (str,), "overrides": (list,),
}  # fmt: skip
"""Types of keys that are read from the resolved scenario and from the provenance."""


@final
class StoredKeys(dict[str, Any]):
    """A mapping of a stored text, whose missing keys raise ResultError. `of` names the file and text in that error."""

    of = ""

    def __missing__(self, key: str) -> Any:
        raise ResultError(f"{self.of} has no key '{key}'")


def parsed(text: str, what: str) -> StoredKeys:
    """The mapping in a JSON text.

    Args:
        text: the text.
        what: file and name of the text, with which errors begin.

    Raises:
        ResultError: the text is no JSON, is no mapping, or a known key is of another type.
    """
    try:
        values = json.loads(text, object_hook=StoredKeys)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{what} is not JSON: {error}") from error
    if not isinstance(values, StoredKeys):
        raise ResultError(f"{what} is no mapping of keys")
    values.of = what
    for holder in (values, values.get("git")):  # a missing key counts as an empty value of its type
        for key, types in TYPES.items():
            if isinstance(holder, StoredKeys) and not isinstance(holder.get(key, types[0]()), types):
                raise ResultError(f"{what} has a key '{key}' of another type than wsnsim writes")
    if not all(
        isinstance(word, str) for key in ("cpu_features", "plugins", "overrides") for word in values.get(key, ())
    ):
        raise ResultError(f"{what} has a list of something else than texts")
    return values


DAMAGED: Final = (
    OSError, RuntimeError, KeyError, ValueError, TypeError, IndexError, OverflowError, MemoryError, SystemError
)  # fmt: skip
"""What HDF5 and h5py raise where a file is damaged."""
NO_SIGNATURE: Final = "file signature not found"
"""What HDF5 says of a file of another format."""


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
    with opened(path) as content:
        group = _group(content, path, table)
        found = _columns(content, group, path, columns)
        wanted = slice(None) if rows is None else rows
        return {name: column.values(wanted) for name, column in found.items()}


def read_with_meanings(
    path: str | Path, table: str, columns: Sequence[str] | None = None
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """(columns as from `read_table`, words of the category columns); the file is opened once.

    The rows of short tables are read in one piece, see `packed_rows`.
    """
    with opened(path) as content:
        group = _group(content, path, table)
        if (packed := packed_rows(group, table)) is not None:
            return _unpacked(packed, columns, content, group, path)
        found = _columns(content, group, path, columns)
        words = {name: words_of(content, column) for name, column in found.items()}
        return {name: column.values() for name, column in found.items()}, {n: w for n, w in words.items() if w}


def tables(path: str | Path) -> dict[str, TableSize]:
    """The tables in the file and their sizes. No values are read."""
    with opened(path) as content:
        return {name: _size(content, path, name) for name in TABLES if name in content.names}


def row_count(path: str | Path, table: str) -> int:
    """The number of rows of a table."""
    with opened(path) as content:
        group = _group(content, path, table)
        return content.column(group, column_names(content, group)[0]).rows


def table_names(path: str | Path) -> list[str]:
    """The names of the tables in the file."""
    with opened(path) as content:
        return [name for name in TABLES if name in content.names]


def meanings(path: str | Path, table: str, column: str) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () for other columns."""
    with opened(path) as content:
        return words_of(content, _columns(content, _group(content, path, table), path, [column])[column])


def all_meanings(path: str | Path, table: str) -> dict[str, tuple[str, ...]]:
    """{column: the words of a category column, in the order of its codes; () for other columns} of a table."""
    with opened(path) as content:
        found = _columns(content, _group(content, path, table), path, None)
        return {name: words_of(content, column) for name, column in found.items()}


def read_text(path: str | Path, name: str, optional: bool = False) -> str:
    """One of the texts `scenario/source_yaml`, `scenario/resolved_json` and `provenance_json`.

    Args:
        path: result file.
        name: name of the text.
        optional: whether the text may be missing, as after a killed run; it is '' then.
    """
    with opened(path) as content:
        held = text_names(content)
        if name in held:
            return content.text(name)
        if optional:
            return ""
        raise ResultError(f"{path}: has no text '{name}' ({did_you_mean(name, held)})")


def read_json(path: str | Path, name: str, optional: bool = False) -> dict[str, Any]:
    """A JSON text, `scenario/resolved_json` or `provenance_json`, as a dict; a missing key is a ResultError.

    Args:
        path: result file.
        name: name of the text.
        optional: whether the text may be missing, as after a killed run; the dict is empty then.
    """
    text = read_text(path, name, optional)
    return parsed(text, f"{path}: the text '{name}'") if text or not optional else {}


def attributes(path: str | Path) -> dict[str, Any]:
    """The root's attributes: status, schema_version, wsnsim_version, states (name, unit) and position (indices)."""
    with opened(path) as content:
        return {
            "status": str(content.attribute(content.root, "status")),
            "schema_version": int(content.attribute(content.root, "schema_version")),
            "wsnsim_version": str(content.attribute(content.root, "wsnsim_version")),
            "states": states_of(content),
            "position": position_of(content),
        }


@contextmanager
def opened(path: str | Path, unfinished: bool = False) -> Iterator[Content]:
    """Open a file for reading after checking that it is a result. Damage that is found later also raises ResultError.

    Args:
        path: result file.
        unfinished: whether the file of an unfinished run may be opened.
    """
    path = Path(path)
    if not os.path.isfile(path):  # noqa: PTH113 - Path.is_file raises if a name is too long
        irregular = "is a folder, not a result" if os.path.isdir(path) else why_not_regular(path)  # noqa: PTH112
        raise ResultError(f"{path}: {irregular or 'no such file' + _nearest(path)}")
    try:
        file = open_to_read(path)
        try:
            content = Content(file)
            _check(content, path, unfinished)
            yield content
        finally:
            file.close()
    except BlockingIOError as error:
        raise ResultError(f"{path}: is still being written") from error
    except DamagedContent as error:
        raise ResultError(f"{path}: cannot be read: {error}") from error
    except DAMAGED as error:
        said = f"cannot be read: {reason(error)}"
        if said.endswith(NO_SIGNATURE):
            said = "is not a wsnsim result: these end in .h5, and `wsnsim run` writes them"
        raise ResultError(f"{path}: {said}") from error


def column_names(content: Content, group: h5g.GroupID) -> list[str]:
    """The names of a table's columns, in order."""
    names = content.attribute(group, "columns")
    if not isinstance(names, list) or not names or len(set(names)) != len(names) or not isinstance(names[0], str):
        raise DamagedContent(f"table {name_of(group)} does not say what columns it has")
    return names


def words_of(content: Content, column: StoredColumn) -> tuple[str, ...]:
    """The words of a category column, in the order of its codes; () for other columns."""
    words = tuple(str(content.attribute(column.dataset, "flag_meanings") or "").split())
    if words and (column.dtype.kind != "u" or column.dtype.itemsize > 2):
        raise DamagedContent(f"{column.name}: its values are no codes of words")
    return words


def text_names(content: Content) -> list[str]:
    """The names of the texts in the file."""
    return [name for name in TEXTS if content.holds(name)]


def states_of(content: Content) -> tuple[tuple[str, str], ...]:
    """(name, unit) of each state column."""
    names, units = (content.attribute(content.root, name) for name in ("states", "state_units"))
    if not isinstance(names, list) or not isinstance(units, list) or len(names) != len(units):
        raise DamagedContent("the file does not say what state columns it has")
    return tuple((str(name), str(unit)) for name, unit in zip(names, units, strict=True))


def position_of(content: Content) -> tuple[int, ...] | None:
    """The indices of the position among the state columns, None if the file does not say."""
    indices = content.attribute(content.root, "position")
    if indices is None:
        return None
    count = len(states_of(content))
    if not isinstance(indices, list) or not all(isinstance(i, int) and 0 <= i < count for i in indices):
        raise DamagedContent("the position is not among the state columns")
    return tuple(indices)


def _check(content: Content, path: Path, unfinished: bool) -> None:
    found, status = (content.attribute(content.root, name) for name in ("schema_version", "status"))
    if found is None or status is None:
        raise ResultError(f"{path}: is an HDF5 file, but not a wsnsim result")
    if not isinstance(found, int):
        raise DamagedContent("its schema version is no number")
    demand_schema(path, found, content.attribute(content.root, "wsnsim_version"))
    if status == WRITING and not unfinished:
        raise ResultError(f"{path}: is the file of an unfinished run; `wsnsim recover` recovers its rows")


def _group(content: Content, path: str | Path, table: str) -> h5g.GroupID:
    if table not in TABLES or table not in content.names:
        held = [name for name in content.names if name in TABLES]
        raise ResultError(f"{path}: has no table '{table}' ({did_you_mean(table, held)})")
    return content.group(table)


def _columns(
    content: Content, group: h5g.GroupID, path: str | Path, wanted: Sequence[str] | None
) -> dict[str, StoredColumn]:
    """The columns of a table that are wanted, all if None, checked and equally long."""
    names = column_names(content, group) if wanted is None else [_checked(n, content, group, path) for n in wanted]
    found = dict(zip(names, content.columns(group, names), strict=True))
    kinds = KINDS[name_of(group)]
    for name, column in found.items():
        if column.dtype.kind != kinds.get(name, column.dtype.kind):
            raise DamagedContent(f"{column.name}: its values are of the type {column.dtype}")
    return found


def _unpacked(
    packed: PackedRows, columns: Sequence[str] | None, content: Content, group: h5g.GroupID, path: str | Path
) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]]]:
    """(columns, words) of packed rows."""
    held = packed.records.dtype.names or ()
    names = held if columns is None else [n if n in held else _checked(n, content, group, path) for n in columns]
    found = {name: np.ascontiguousarray(packed.records[name]) for name in names}
    return found, {name: words for name, words in packed.words.items() if name in found}


def _checked(name: str, content: Content, group: h5g.GroupID, path: str | Path) -> str:
    """The name of a column that the table has. Raises ResultError."""
    held = column_names(content, group)
    if name not in held:
        table = name_of(group)
        raise ResultError(f"{path}: table {table} has no column '{name}' ({did_you_mean(name, held)})")
    return name


def _size(content: Content, path: str | Path, table: str) -> TableSize:
    """The size of a table. Only the first column is checked here, the others when they are read."""
    group = _group(content, path, table)
    names = column_names(content, group)
    first = content.column(group, names[0])
    stored = sum(content.stored_bytes(group, name) for name in names[1:])
    return TableSize(first.rows, tuple(names), first.stored + stored)


def _nearest(path: Path) -> str:
    folder = path.parent if os.path.isdir(path.parent) else Path(os.devnull)  # noqa: PTH112 - names that are too long
    known = [*folder.glob("*.h5"), *(file.parent for file in folder.glob("*/campaign.json"))]
    near = nearest(path.name, [file.name for file in known])
    return f", did you mean '{path.with_name(near[0])}'?" if near else ""
