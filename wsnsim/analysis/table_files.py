"""Export of tables as files for other tools: Parquet and CSV, a file a table; `analysis.matlab` writes MATLAB files.

parquet(source, folder, tables=()) -> [(file, rows), ...]      needs pyarrow (extra `parquet`)
csv(source, folder, tables=()) -> [(file, rows), ...]
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pandas as pd

import wsnsim.recording as recording
from wsnsim.analysis import frames
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.recording.atomic_files import write_atomically
from wsnsim.recording.folder import Folder


def parquet(source: Path, folder: Path, tables: Sequence[str] = ()) -> list[tuple[Path, int]]:
    """Write each table of a result, or of a campaign with its swept parameters, to FOLDER/TABLE.parquet.

    Returns:
        (file, number of rows) of each table.

    Raises:
        UsageError: pyarrow is missing, or there is no such table.
        ResultError: the source cannot be read.
        StorageError: a file cannot be written.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise UsageError("--parquet requires pyarrow: pip install 'wsnsim[parquet]'") from None
    return _written(source, folder, tables, ".parquet", lambda frame, path: frame.to_parquet(path, index=False))


def csv(source: Path, folder: Path, tables: Sequence[str] = ()) -> list[tuple[Path, int]]:
    """Write each table of a result, or of a campaign with its swept parameters, to FOLDER/TABLE.csv.

    Floats have as many digits as give them back exactly; NaN is an empty cell.

    Returns:
        (file, number of rows) of each table.

    Raises:
        UsageError: there is no such table.
        ResultError: the source cannot be read.
        StorageError: a file cannot be written.
    """
    return _written(source, folder, tables, ".csv", lambda frame, path: frame.to_csv(path, index=False))


def read_tables(source: Path, tables: Sequence[str] = ()) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield (name, frame) of the tables of a result or of a campaign; of all if none is named.

    Raises:
        UsageError: there is no such table.
        ResultError: the source cannot be read.
    """
    held = tables_of(source)
    for name in tables:
        if name not in held:
            raise UsageError(f"{source} holds no table '{name}' ({did_you_mean(name, held)})")
    for name in dict.fromkeys(tables or held):
        yield name, frames.read(source, name)


def tables_of(source: Path) -> tuple[str, ...]:
    """The tables of a result, or of the first file of a campaign."""
    if not source.is_dir():
        return tuple(recording.tables(source))
    campaign = Folder(source)
    for point in campaign.manifest().points:
        for batch in campaign.batches(point.id):
            return tuple(recording.tables(batch.path))
    raise ResultError(f"{source}: holds no results yet")


def _written(
    source: Path, folder: Path, tables: Sequence[str], suffix: str, write: Callable[[pd.DataFrame, Path], object]
) -> list[tuple[Path, int]]:
    """Write each table to a file of its own, as a whole or not at all."""
    written = []
    for name, frame in read_tables(source, tables):
        place = folder / f"{name}{suffix}"
        write_atomically(place, partial(write, frame))
        written.append((place, len(frame)))
    return written
