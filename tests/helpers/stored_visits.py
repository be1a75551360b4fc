"""Simulated visits that are kept in files, so that a study of lifetimes can be stopped and go on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.lifetimes.library import Library

NAMES: Final = ("joules", "tracked", "seconds", "false_time")


def stored_visit(path: Path, dead: frozenset[int], make: Callable[[], Library]) -> Library:
    """The visit of a file; if there is none, it is made and written."""
    if not path.exists():
        made = make()
        np.savez(path, **{name: getattr(made, name) for name in NAMES})
    with np.load(path) as held:
        return Library(**{name: held[name] for name in NAMES}, dead=dead)


def joined(libraries: Sequence[Library]) -> Library:
    """The visits of libraries of the same network."""
    return functools.reduce(Library.joined, libraries)
