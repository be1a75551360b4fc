"""A tape of every kernel call of a run, to be played again: what the mathematics costs without anything around it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher


class Tape:
    """Kernel calls in order, each with copies of its arguments as they were."""

    def __init__(self) -> None:
        self._calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Within it, every call from models and trackers into a compiled kernel is written down."""
        patched = list(self._patch())
        try:
            yield
        finally:
            for module, name, kernel in patched:
                setattr(module, name, kernel)

    def play(self) -> None:
        """Make all the calls again."""
        for kernel, arguments in self._calls:
            kernel(*arguments)

    def _patch(self) -> Iterator[tuple[Any, str, Dispatcher]]:
        rooms = ("wsnsim.models.", "wsnsim.trackers.", "wsnsim.kernels.")
        for module in [module for name, module in list(sys.modules.items()) if name.startswith(rooms)]:
            for name, value in list(vars(module).items()):
                if isinstance(value, Dispatcher):
                    setattr(module, name, self._noting(value))
                    yield module, name, value

    def _noting(self, kernel: Dispatcher) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:  # kernels take no keywords
            copies = tuple(a.copy() if isinstance(a, np.ndarray) else a for a in arguments)
            self._calls.append((kernel, copies))
            return kernel(*arguments)

        return call
