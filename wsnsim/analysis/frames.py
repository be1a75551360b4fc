"""Tables of results as pandas DataFrames, as `wsnsim.read` gives them, and their export for other tools.

read(path_or_pattern, table, columns=None) -> DataFrame
parquet(source, folder, tables=()) -> [(file, rows), ...]      needs pyarrow (extra `parquet`)
csv(source, folder, tables=()) -> [(file, rows), ...]
matlab(source, file, tables=()) -> [(table, rows), ...]        version 5: a struct per table, with its columns as fields

In MATLAB, `d = load('x.mat'); T = struct2table(d.estimates)` makes a table of it; in Octave fields are columns as well.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

import wsnsim.recording as recording
from wsnsim.analysis import campaigns
from wsnsim.analysis.campaigns import read_file, stacked
from wsnsim.base.errors import ResultError, UsageError, did_you_mean, shown_value
from wsnsim.base.tables import TABLES
from wsnsim.base.version import __version__
from wsnsim.recording import table_names
from wsnsim.recording.atomic_files import write_atomically
from wsnsim.recording.folder import Folder


def read(path: str | Path, table: str = "", columns: Sequence[str] | None = None) -> pd.DataFrame:
    """A table of a result file, of a campaign, or of all files of a pattern.

    Categories are pandas Categoricals. A pattern adds a column `file`. The rows of a campaign are in the order of its
    points and runs, and its first columns are the swept parameters in their own types.

    Args:
        path: a result file, the folder of a campaign, or a pattern such as `results/*.h5`.
        table: name of the table; there is no default, and an error names those that the file has.
        columns: the columns to read; None for all.

    Raises:
        ResultError: there is no such file, table or column (the nearest name is given), or a file cannot be read.
        UsageError: it is no path, or no table is named.
    """
    if not isinstance(path, str | os.PathLike):
        allowed = "the path of a result file, the folder of a campaign, or a pattern such as 'results/*.h5'"
        held = f"; its tables are result.table({table!r})" if hasattr(path, "table") else ""
        raise UsageError(f"path: expected {allowed}, got {shown_value(path)}{held}")
    path = Path(path)
    if not table:
        known = table_names(path) if path.suffix == ".h5" and path.is_file() else TABLES
        raise UsageError(f"read({str(path)!r}, table): name the table: {', '.join(known)}")
    if os.path.isdir(path):  # noqa: PTH112 - a name that is too long is none
        return campaigns.read(path, table, columns)
    if os.path.exists(path) or not set("*?[") & set(str(path)):  # noqa: PTH110
        return read_file(path, table, columns)
    files = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    if not files:
        raise ResultError(f"{path}: no file matches")
    frames = [read_file(file, table, columns) for file in files]
    joined = stacked(files, frames, table)
    owners = np.repeat(np.arange(len(files)), [len(frame) for frame in frames])
    joined["file"] = pd.Categorical.from_codes(owners, [str(file) for file in files])
    return joined


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
        yield name, read(source, name)


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


LONGEST_NAME: Final = 63
"""Characters of a name in MATLAB (`namelengthmax`)."""
LARGEST: Final = 2**31 - 1
"""Bytes of the largest variable in a file of version 5."""
CELL: Final = 64
"""Bytes that a cell with a short text takes, with its header."""
KEYWORDS: Final = frozenset((
    "break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global", "if",
    "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while",
))  # fmt: skip


def matlab(source: Path, file: Path, tables: Sequence[str] = ()) -> list[tuple[str, int]]:
    """Write the tables of a result, or of a campaign with its swept parameters, into one MATLAB file.

    Numbers are column vectors of their own class, truth values logical, texts cell arrays of character vectors. Names
    that MATLAB does not allow are changed (`legal_names`). The variable `wsnsim` says which version wrote the file.

    Returns:
        (table, number of rows) of each table.

    Raises:
        UsageError: there is no such table, or one is too large for the format.
        ResultError: the source cannot be read.
        StorageError: the file cannot be written.
    """
    from scipy.io import savemat

    found = dict(read_tables(source, tables))
    structs = {name: _struct(source, name, frame) for name, frame in found.items()}
    named = dict(zip(legal_names(structs), structs.values(), strict=True))
    about = {"wsnsim": {"version": __version__, "source": str(source.name)}}

    def write(path: Path) -> None:
        with path.open("wb") as stream:
            savemat(stream, about | named, long_field_names=True, oned_as="column", do_compression=True)

    write_atomically(file, write)
    return [(name, len(frame)) for name, frame in found.items()]


def legal_names(names: Iterable[str]) -> list[str]:
    """Names that MATLAB allows, all different: letters, digits and _, a letter first, 63 characters, no keyword."""
    legal: list[str] = []
    for name in names:
        word = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST_NAME]
        if not re.match(r"[A-Za-z]", word) or word in KEYWORDS:
            word = f"x_{word}"[:LONGEST_NAME]
        free, number = word, 1
        while free in legal:
            number += 1
            free = f"{word[: LONGEST_NAME - 6]}_{number}"
        legal.append(free)
    return legal


def _struct(source: Path, table: str, frame: pd.DataFrame) -> dict[str, np.ndarray]:
    """The columns of a table as MATLAB has them, each (n, 1)."""
    columns = {}
    for name, legal in zip(frame.columns, legal_names(map(str, frame.columns)), strict=True):
        values = _values(frame[name])
        size = CELL * len(values) if values.dtype == object else values.nbytes
        if size > LARGEST:
            raise UsageError(
                f"{source}: column {table}.{name} needs {size / 1e9:.1f} GB, a MATLAB file holds 2.1 GB a variable: "
                "name smaller tables with --table, or read the result itself with h5read"
            )
        columns[legal] = values.reshape(-1, 1)
    return columns


def _values(column: pd.Series[Any]) -> np.ndarray:
    """The values of a column: numbers, truth values, or texts as objects, which become cells."""
    if column.dtype.kind in "biuf":
        numbers: np.ndarray = column.to_numpy()
        return numbers
    cells = np.empty(len(column), dtype=object)
    cells[:] = ["" if value is None or value != value else str(value) for value in column.tolist()]
    return cells
