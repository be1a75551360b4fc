"""How long this process has compiled kernels. It happens once on a machine, and is no part of a run.

time_without_compilation() -> s     compilation_seconds() -> s     compilation_wall() -> s     with announced(call): ...
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from wsnsim.kernels.compilation import COMPILATION_TIME


def compilation_seconds() -> float:
    """The processor time (s) in which this process has compiled kernels. Loading a cached one is not compiling."""
    return COMPILATION_TIME.seconds


def compilation_wall() -> float:
    """The real time (s) in which this process has compiled kernels."""
    return COMPILATION_TIME.wall


def time_without_compilation() -> float:
    """The processor time (s) of this process, as `time.process_time` gives it, without that of compilation."""
    return time.process_time() - COMPILATION_TIME.seconds


@contextmanager
def announced(call: Callable[[], None] | None) -> Iterator[None]:
    """Call a function when the first kernel is compiled, if one is."""

    def announce() -> None:
        COMPILATION_TIME.announce = None
        if call is not None:
            call()

    COMPILATION_TIME.announce = announce
    try:
        yield
    finally:
        COMPILATION_TIME.announce = None
