"""What a killed run left, made a result again.

recover(tmp, out=None) -> path of a file whose status is 'partial'
"""

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
    """Copy the whole chunks of each table, cut to equal length, to `out`, or to the name that the run would have given.

    Tables that had not filled a chunk come out empty. The temporary file is left alone.

    Raises:
        ResultError: `tmp` cannot be read, holds no whole chunk, or the final name is taken and no `out` is given.
    """
    tmp = Path(tmp)
    final = Path(out) if out is not None else _final_name(tmp)
    if out is None and final.exists():
        raise ResultError(f"{final}: exists already; say where the recovered file goes")
    with opened(tmp, unfinished=True) as file:
        if file.attrs["status"] != "writing":
            raise ResultError(f"{tmp}: is a finished result, there is nothing to recover")
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
                f"{tmp}: holds no whole chunk of {CHUNK} rows that can be read; there is nothing to recover"
            )


def _final_name(tmp: Path) -> Path:
    parsed = re.fullmatch(r"(.+)\.[^.]+\.\d+(?:-\d+)?\.tmp", tmp.name)
    if parsed is None:
        raise ResultError(
            f"{tmp}: is not named like what a killed run leaves (NAME.host.pid.tmp); say where the recovered file goes"
        )
    return tmp.with_name(f"{parsed[1]}.h5")


def _whole_rows(group: h5py.Group) -> int:
    """Rows of which every column's chunks are in the file. A chunk that never reached it would read as zeros."""
    columns = [group.get(name) for name in column_names(group)]
    if any(column is None for column in columns):
        return 0
    result: int = CHUNK * min(min(column.shape[0] // CHUNK, column.id.get_num_chunks()) for column in columns)
    return result


def _whole_chunks(group: h5py.Group) -> Iterator[dict[str, np.ndarray]]:
    """The table's chunks up to the first that cannot be read."""
    names = column_names(group)
    for start in range(0, _whole_rows(group), CHUNK):
        try:
            chunk = {name: group[name][start : start + CHUNK] for name in names}
        except OSError:
            return
        yield chunk
