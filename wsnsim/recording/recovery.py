"""The recovery of the rows that a killed run had written."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from h5py import h5g

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import TABLES, Words
from wsnsim.recording.contents import Content, names_in
from wsnsim.recording.object_headers import StoredColumn
from wsnsim.recording.reader import column_names, opened, position_of, states_of, text_names, words_of
from wsnsim.recording.rows import CHUNK, PARTIAL, WRITING, DamagedContent
from wsnsim.recording.writer import ResultFile


def recover(tmp: str | Path, out: str | Path | None = None) -> Path:
    """Copy the complete chunks of each table to a result with the status `partial`; return its path.

    Tables without a complete chunk are empty. The temporary file is kept.

    Args:
        tmp: temporary file of the killed run.
        out: file to write, by default the name that the run would have used.

    Raises:
        ResultError: `tmp` cannot be read or has no complete chunk, or the file exists and no `out` is given.
    """
    tmp = Path(tmp)
    final = Path(out) if out is not None else _final_name(tmp)
    if out is None and final.exists():
        raise ResultError(f"{final}: exists; give another file with --out")
    with opened(tmp, unfinished=True) as content:
        if content.attribute(content.root, "status") != WRITING:
            raise ResultError(f"{tmp}: is a complete result; there is nothing to recover")
        _copy(content, tmp, final)
    return final


def _copy(content: Content, tmp: Path, final: Path) -> None:
    held, copied = {table: content.group(table) for table in TABLES if table in content.names}, 0
    wanted = dict.fromkeys(held, True)

    def has(table: str, column: str) -> bool:
        return table in held and column in column_names(content, held[table])

    layout = {
        "duty_cycled": has("runs", "radio_on"),
        "absences": has("tracks", "time_present"),
        "harvests": has("nodes", "harvested"),
        "headless": has("estimates", "disagreement"),
        "late_readings": has("tracks", "late_readings"),
        "unlabelled": has("estimates", "track") or has("runs", "gospa"),
    }
    components = 2 if has("readings", "component") or has("detections", "component") else 1
    file = ResultFile(
        final,
        states_of(content),
        wanted,
        position=position_of(content),
        components=components,
        **layout,
        status=PARTIAL,
    )
    with file as result:
        if words := _words(content, held, "events", "what"):
            result.words = words
        if words := _words(content, held, "tracker_state", "name"):
            result.state_names = words
        for name in text_names(content):
            result.set_text(name, content.text(name))
        for table, group in held.items():
            for chunk in _whole_chunks(content, group):
                result.write(table, chunk)
                copied += 1
        if not copied:
            raise ResultError(
                f"{tmp}: has no complete chunk of {CHUNK} rows that can be read; there is nothing to recover"
            )


def _words(content: Content, held: Mapping[str, h5g.GroupID], table: str, name: str) -> Words | None:
    """The words of a category column that had been written; None if the column does not exist yet."""
    if table not in held or name not in names_in(held[table]):
        return None
    return Words(words_of(content, content.column(held[table], name, complete=False)))


def _final_name(tmp: Path) -> Path:
    parsed = re.fullmatch(r"(.+)\.[^.]+\.\d+(?:-\w+)?\.tmp", tmp.name)
    if parsed is None:
        raise ResultError(
            f"{tmp}: is not named NAME.host.pid.tmp, like the file of a killed run; give another file with --out"
        )
    return tmp.with_name(f"{parsed[1]}.h5")


def _whole_chunks_of(column: StoredColumn) -> int:
    """Number of chunks from the first on that are in the file and within the column."""
    if column.chunk != CHUNK:
        return 0
    expected = range(0, column.rows - CHUNK + 1, CHUNK)
    return next((i for i, (a, b) in enumerate(zip(expected, column.chunks, strict=False)) if a != b),
                min(len(expected), len(column.chunks)))  # fmt: skip


def _whole_chunks(content: Content, group: h5g.GroupID) -> Iterator[dict[str, np.ndarray]]:
    """The chunks of a table, up to the first that cannot be read."""
    names = column_names(content, group)
    if not set(names) <= set(names_in(group)):
        return
    columns = dict(zip(names, content.columns(group, names, complete=False), strict=True))
    for start in range(0, CHUNK * min(map(_whole_chunks_of, columns.values())), CHUNK):
        try:
            chunk = {name: column.values(slice(start, start + CHUNK)) for name, column in columns.items()}
        except (OSError, DamagedContent):
            return
        yield chunk
