"""Rows that two data files share: a law must not be judged on rows that it was fitted to, whatever a file is called.

shared_with(rows, files) -> (path, share) of the file that shares too many of these rows, or None
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Set
from typing import Final

SAME_SHARE: Final = 0.01
"""Files that share this part of their rows are not independent (our choice: far more than coincidence gives)."""


def share(first: Set[Hashable], second: Set[Hashable]) -> float:
    """The number of shared rows, relative to the smaller file, so that neither may be a part of the other."""
    return len(first & second) / max(min(len(first), len(second)), 1)


def shared_with(rows: Set[Hashable], files: Mapping[str, Set[Hashable]]) -> tuple[str, float] | None:
    """The file that shares most with these rows, and how much, if that or the share with all files is too large."""
    if not files:
        return None
    path = max(files, key=lambda name: share(rows, files[name]))
    largest = max(share(rows, files[path]), share(rows, frozenset().union(*files.values())))
    return (path, largest) if largest >= SAME_SHARE else None
