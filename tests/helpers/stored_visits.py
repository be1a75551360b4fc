"""Simulated visits that are kept in files, so that a study of lifetimes can be stopped and go on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from wsnsim.lifetime.library import Library


def stored_visit(path: Path, dead: frozenset[int], make: Callable[[], Library]) -> Library:
    """The visit of a file; if there is none, it is made and written."""
    if not path.exists():
        made = make()
        np.savez(path, joules=made.joules, tracked=made.tracked, seconds=made.seconds)
    with np.load(path) as held:
        return Library(held["joules"], held["tracked"], held["seconds"], dead)


def joined(libraries: Sequence[Library]) -> Library:
    """The visits of libraries of the same network."""
    return functools.reduce(Library.joined, libraries)
