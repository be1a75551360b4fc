"""Tables of single result files as pandas DataFrames.

read_file(path, table, columns=None) -> DataFrame        stacked(files, frames, table) -> DataFrame
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import union_categoricals

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import DUTY_CYCLED
from wsnsim.recording import read_with_meanings


def read_file(path: str | Path, table: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """A table of one result file."""
    return data_frame(*read_with_meanings(path, table, columns))


def data_frame(columns: Mapping[str, np.ndarray], words: Mapping[str, tuple[str, ...]]) -> pd.DataFrame:
    """The columns as a frame, those with words as Categoricals."""
    return pd.DataFrame({name: _series(values, words.get(name, ())) for name, values in columns.items()})


def stacked(files: Sequence[Path], frames: Sequence[pd.DataFrame], table: str) -> pd.DataFrame:
    """The rows of several files in one frame, with NaN in columns that only files of duty-cycled MACs have.

    Raises ResultError if the files differ in other columns.
    """
    frames = _padded(frames)
    for file, frame in zip(files, frames, strict=True):
        if list(frame) != list(frames[0]):
            raise ResultError(f"{file}: table {table} has other columns than in {files[0]}; name the columns to read")
    return pd.DataFrame({name: _joined([frame[name] for frame in frames]) for name in frames[0]})


def _padded(frames: Sequence[pd.DataFrame]) -> list[pd.DataFrame]:
    """The frames; those without the columns of duty-cycled MACs get them where another has them."""
    widest = max(frames, key=lambda frame: len(frame.columns))
    return [
        frame.reindex(columns=widest.columns)
        if frame.columns.size < widest.columns.size and {*widest} - {*frame} <= {*DUTY_CYCLED} and {*frame} <= {*widest}
        else frame
        for frame in frames
    ]


def _series(values: np.ndarray, words: tuple[str, ...]) -> Any:
    """The column, with codes as words. A code without a word is 'unknown_' and its number."""
    if not words:
        return values
    unknown = range(len(words), int(values.max(initial=0)) + 1)
    return pd.Categorical.from_codes(values, [*words, *(f"unknown_{code}" for code in unknown)])


def _joined(pieces: list[pd.Series]) -> Any:
    """Concatenated columns. Categories with different codes are united by their words.

    A file without rows of a table may have no categories for it.
    """
    categories = [piece for piece in pieces if isinstance(piece.dtype, pd.CategoricalDtype)]
    if categories:
        return union_categoricals(categories)
    return np.concatenate([piece.to_numpy() for piece in pieces])
