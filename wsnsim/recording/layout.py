"""What a result file looks like, as far as writer and readers must agree; and HDF5's complaints in plain words.

Root attributes: `schema_version`, `wsnsim_version`, `status`, `states` and `state_units` (the motion model's
columns), `position` (which of them are the position, as numbers).
A group a table with the attribute `columns`, in order; a dataset a column with `units`, `description`, and for
categories the CF attributes `flag_values` and `flag_meanings`. String datasets: `TEXTS`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from wsnsim.base.errors import StorageError

SCHEMA_VERSION: Final = 1
CHUNK: Final = 65_536
FLUSH_EVERY: Final = 30.0
TEXTS: Final = ("scenario/source_yaml", "scenario/resolved_json", "provenance_json")
WRITING: Final = "writing"
COMPLETE: Final = "complete"
PARTIAL: Final = "partial"


def flag_words(words: Iterable[str]) -> tuple[str, ...]:
    """The words as CF `flag_meanings` can hold them: no blanks inside, 'none' for an empty one, no two alike."""
    flags: list[str] = []
    for code, word in enumerate(words):
        flag = "_".join(word.split()) or "none"
        flags.append(f"{flag}_{code}" if flag in flags else flag)
    return tuple(flags)


def reason(error: BaseException) -> str:
    """The part of an HDF5 or operating system error that a user can act on."""
    text = str(error)
    quoted = re.search(r"error message = '([^']*)'", text)
    if quoted:
        return quoted[1]
    if isinstance(error, OSError) and error.strerror and "(" not in error.strerror:
        return error.strerror
    bracketed = re.search(r"\((.*)\)", text, re.DOTALL)
    return (bracketed and bracketed[1]) or text or type(error).__name__


def cannot_write(path: Path, error: BaseException) -> StorageError:
    """The error of a result that could not be written, with its reason."""
    return StorageError(f"{path}: cannot be written: {reason(error)}")
