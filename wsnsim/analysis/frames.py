"""Tables of results as pandas DataFrames, as `wsnsim.read` gives them.

read(path_or_pattern, table, columns=None) -> DataFrame
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns
from wsnsim.analysis.data_frames import read_file, stacked
from wsnsim.base.errors import ResultError, UsageError, shown_value
from wsnsim.base.tables import TABLES
from wsnsim.recording import table_names


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
    joined["file"] = _file_column(files, frames)
    return joined


def _file_column(files: list[Path], frames: list[pd.DataFrame]) -> pd.Categorical:
    owners = np.repeat(np.arange(len(files)), [len(frame) for frame in frames])
    return pd.Categorical.from_codes(owners, [str(file) for file in files])
