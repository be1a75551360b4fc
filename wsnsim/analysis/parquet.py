"""Export of tables as Parquet files, for tools that do not read HDF5. Needs pyarrow (extra `parquet`).

export(source, folder, tables=()) -> [(file, rows), ...]
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import wsnsim.recording as recording
from wsnsim.analysis import frames
from wsnsim.base.errors import ResultError, StorageError, UsageError, did_you_mean
from wsnsim.recording.folder import Folder
from wsnsim.recording.layout import reason


def export(source: Path, folder: Path, tables: Sequence[str] = ()) -> list[tuple[Path, int]]:
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
    held = tables_of(source)
    for name in tables:
        if name not in held:
            raise UsageError(f"{source} holds no table '{name}' ({did_you_mean(name, held)})")
    written = []
    for name in tables or held:
        frame = frames.read(source, name)
        place, tmp = folder / f"{name}.parquet", folder / f"{name}.parquet.tmp"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            frame.to_parquet(tmp, index=False)
            tmp.replace(place)
        except OSError as error:
            with contextlib.suppress(OSError):
                tmp.unlink()
            raise StorageError(f"{place}: cannot be written: {reason(error)}") from error
        written.append((place, len(frame)))
    return written


def tables_of(source: Path) -> tuple[str, ...]:
    """The tables of a result, or of the first file of a campaign."""
    if not source.is_dir():
        return tuple(recording.tables(source))
    campaign = Folder(source)
    for point in campaign.manifest().points:
        for batch in campaign.batches(point.id):
            return tuple(recording.tables(batch.path))
    raise ResultError(f"{source}: holds no results yet")
