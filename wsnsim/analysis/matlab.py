"""Export of tables as one MATLAB file (version 5): a struct per table, whose fields are its columns.

export(source, file, tables=()) -> [(table, rows), ...]

In MATLAB, `d = load('x.mat'); T = struct2table(d.estimates)` makes a table of it; in Octave fields are columns as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.analysis.table_files import read_tables
from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.recording.atomic_files import write_atomically

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


def export(source: Path, file: Path, tables: Sequence[str] = ()) -> list[tuple[str, int]]:
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
