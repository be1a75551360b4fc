"""The layout of a result file, which writer and readers share, and the messages of HDF5 errors.

Attributes of the root: `schema_version`, `wsnsim_version`, `status`, `states` and `state_units` (the columns of the
motion model's state), `position` (the indices of the position among them). Each table is a group with the attribute
`columns` (their order). Each column is a dataset with `units`, `description`, and, for categories, the CF attributes
`flag_values` and `flag_meanings`. `TEXTS` are string datasets.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.base.errors import ResultError, StorageError
from wsnsim.base.tables import TABLES
from wsnsim.base.version import __version__

SCHEMA_VERSION: Final = 2
"""Of results and of manifests of campaigns: another number is another layout, or another meaning of a scenario."""
CHUNK: Final = 65_536
"""Rows of a chunk."""
COMPACT: Final = 2_048
"""Bytes of a column up to which it is stored with its description: the index of its chunks would be as long."""
FLUSH_EVERY: Final = 30.0
"""Seconds between two flushes."""
KINDS: Final = {table: {column.name: np.dtype(column.dtype).kind for column in TABLES[table]} for table in TABLES}
"""Whether the values of a column are signed, unsigned or real: the number of a run or step is never negative."""
TEXTS: Final = ("scenario/source_yaml", "scenario/resolved_json", "provenance_json")
WRITING: Final = "writing"
COMPLETE: Final = "complete"
PARTIAL: Final = "partial"


def flag_words(words: Iterable[str]) -> tuple[str, ...]:
    """The words in the form of CF `flag_meanings`: without spaces, 'none' for an empty word, and distinct."""
    flags: list[str] = []
    for code, word in enumerate(words):
        flag = "_".join(word.split()) or "none"
        flags.append(f"{flag}_{code}" if flag in flags else flag)
    return tuple(flags)


def reason(error: BaseException) -> str:
    """The part of an error of HDF5 or of the operating system that tells a user what to do."""
    text = str(error)
    quoted = re.search(r"error message = '([^']*+)'", text)
    if quoted:
        return quoted[1]
    if isinstance(error, OSError) and error.strerror and "(" not in error.strerror:
        return error.strerror
    bracketed = text.partition("(")[2].rpartition(")")[0]
    return bracketed or text or type(error).__name__


def demand_schema(place: Path, found: int, version: object) -> None:
    """Check the schema version of a result or manifest, written by a version of wsnsim.

    Raises:
        ResultError: An older or newer wsnsim wrote the file.
    """
    if found != SCHEMA_VERSION:
        age = "an older" if found < SCHEMA_VERSION else "a newer"
        raise ResultError(
            f"{place}: was written by {age} wsnsim ({version}), whose files this one ({__version__}) does not read:"
            " use that version, or make the runs again from their scenario"
        )


def cannot_write(path: Path, error: BaseException) -> StorageError:
    """The error of a result that cannot be written, with the reason."""
    return StorageError(f"{path}: cannot be written: {reason(error)}")
