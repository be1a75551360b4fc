"""The recovery of the rows that a killed run had written."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import TABLES, Words
from wsnsim.recording.layout import CHUNK, PARTIAL, TEXTS
from wsnsim.recording.reader import column_names, opened, position_of, states_of, words_of
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
    with opened(tmp, unfinished=True) as file:
        if file.attrs["status"] != "writing":
            raise ResultError(f"{tmp}: is a complete result; there is nothing to recover")
        _copy(file, tmp, final)
    return final


def _copy(file: h5py.File, tmp: Path, final: Path) -> None:
    held, copied = [table for table in TABLES if table in file], 0
    wanted = dict.fromkeys(held, True)
    with ResultFile(final, states_of(file), wanted, position=position_of(file), status=PARTIAL) as result:
        if "events/what" in file:
            result.words = Words(words_of(file["events/what"]))
        if "tracker_state/name" in file:
            result.state_names = Words(words_of(file["tracker_state/name"]))
        for name in TEXTS:
            if name in file:
                result.set_text(name, file[name].asstr()[()])
        for table in held:
            for chunk in _whole_chunks(file[table]):
                result.write(table, chunk)
                copied += 1
        if not copied:
            raise ResultError(
                f"{tmp}: has no complete chunk of {CHUNK} rows that can be read; there is nothing to recover"
            )


def _final_name(tmp: Path) -> Path:
    parsed = re.fullmatch(r"(.+)\.[^.]+\.\d+(?:-\d+)?\.tmp", tmp.name)
    if parsed is None:
        raise ResultError(
            f"{tmp}: is not named NAME.host.pid.tmp, like the file of a killed run; give another file with --out"
        )
    return tmp.with_name(f"{parsed[1]}.h5")


def _whole_rows(group: h5py.Group) -> int:
    """Number of rows whose chunks are in the file for every column. A missing chunk would read as zeros."""
    columns = [group.get(name) for name in column_names(group)]
    if any(column is None for column in columns):
        return 0
    return CHUNK * min(int(min(column.shape[0] // CHUNK, column.id.get_num_chunks())) for column in columns)


def _whole_chunks(group: h5py.Group) -> Iterator[dict[str, np.ndarray]]:
    """The chunks of a table, up to the first that cannot be read."""
    names = column_names(group)
    for start in range(0, _whole_rows(group), CHUNK):
        try:
            chunk = {name: group[name][start : start + CHUNK] for name in names}
        except OSError:
            return
        yield chunk
