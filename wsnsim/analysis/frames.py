"""Tables of results as pandas DataFrames, as `wsnsim.read` gives them.

read(path_or_pattern, table, columns=None) -> DataFrame
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns
from wsnsim.analysis.data_frames import read_file, stacked
from wsnsim.base.errors import ResultError


def read(path: str | Path, table: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """A table of a result file, of a campaign's folder, or of all files that a pattern such as 'results/*.h5' names.

    Categories come as pandas Categoricals. With a pattern there is a further column `file`. Of a campaign the rows are
    in the order of its points and replicates, with a column for each swept parameter in front, in its own type.

    Raises:
        ResultError: there is no such file, table or column (the nearest name is given), or a file cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        return campaigns.read(path, table, columns)
    if path.exists() or not set("*?[") & set(str(path)):
        return read_file(path, table, columns)
    files = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    if not files:
        raise ResultError(f"{path}: no file has such a name")
    frames = [read_file(file, table, columns) for file in files]
    joined = stacked(files, frames, table)
    joined["file"] = _file_column(files, frames)
    return joined


def _file_column(files: list[Path], frames: list[pd.DataFrame]) -> pd.Categorical:
    owners = np.repeat(np.arange(len(files)), [len(frame) for frame in frames])
    return pd.Categorical.from_codes(owners, [str(file) for file in files])
