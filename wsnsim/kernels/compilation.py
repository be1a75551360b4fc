"""Typed decorators that compile kernels with Numba.

| decorator | the compiled function |
| --- | --- |
| `kernel` | is called from Python |
| `inner` | is called from kernels only |
| `inlined` | is called from kernels only, and inlined by LLVM |
| `merged` | is called from kernels only, and inlined by Numba before it compiles |
| `ordered_kernel`, `ordered_inlined` | as `kernel` and `inlined`, with sums in the order in which they are written |
| `exact_kernel`, `exact_inlined` | as `kernel` and `inlined`, rounded after each operation, as NumPy rounds |

Division follows NumPy: the checks that Numba makes by default prevent vectorisation. The fast-math flags keep tests for
NaN and infinity. Functions that only kernels call have no wrapper for Python: it would take longer to compile than the
function itself.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar, final

from numba import njit
from numba.core import event

F = TypeVar("F", bound=Callable[..., Any])
BLAS: Final = "scipy.linalg.cython_blas"


def _import_without_scipy() -> None:
    """Import Numba's array functions, which ask at once whether SciPy has a BLAS, but do not let them import SciPy.

    The import takes longer than a short run, and no kernel of ours uses linear algebra. Those of plug-ins do as ever:
    when Numba compiles them it imports SciPy, and what it noted of the BLAS is made true again.
    """
    if BLAS in sys.modules or "numba.np.arraymath" in sys.modules:
        return
    sys.modules[BLAS] = None  # type: ignore[assignment]
    try:
        from numba.np import arraymath
    finally:
        del sys.modules[BLAS]
    arraymath._HAVE_BLAS = True


_import_without_scipy()


@final
class CompilationTime(event.Listener):
    """The processor time in which this process has compiled kernels. Loading a cached kernel is not compiling.

    Attributes:
        seconds: Processor time (s) until now.
        announce: Called when a compilation begins.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.announce: Callable[[], None] | None = None
        self._depth = 0
        self._began = 0.0

    def on_start(self, event: event.Event) -> None:
        """A kernel is compiled, perhaps because another one that is being compiled calls it."""
        if not self._depth:
            self._began = time.process_time()
            if self.announce is not None:
                self.announce()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """A kernel is compiled, or cannot be."""
        self._depth -= 1
        if not self._depth:
            self.seconds += time.process_time() - self._began


COMPILATION_TIME: Final = CompilationTime()
"""That of this process."""
event.register("numba:compile", COMPILATION_TIME)  # type: ignore[no-untyped-call]


OPTIONS: Final[Mapping[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "arcp", "reassoc"},
    "no_cfunc_wrapper": True,
}
"""Options of every kernel."""
_ORDERED: Final[Mapping[str, Any]] = {**OPTIONS, "fastmath": {"contract", "nsz", "arcp"}}
_EXACT: Final[Mapping[str, Any]] = {**OPTIONS, "fastmath": False}
_INNER: Final[Mapping[str, Any]] = {"no_cpython_wrapper": True}


def kernel(function: F) -> F:
    """Compile a function that Python calls."""
    return _compiled(function, OPTIONS)


def ordered_kernel(function: F) -> F:
    """Compile a function that Python calls, without reordering sums: where rounding errors must cancel."""
    return _compiled(function, _ORDERED)


def inner(function: F) -> F:
    """Compile a function that only kernels call."""
    return _compiled(function, {**OPTIONS, **_INNER})


def inlined(function: F) -> F:
    """Compile a function that LLVM inlines into the kernels that call it."""
    return _compiled(function, {**OPTIONS, **_INNER, "forceinline": True})


def ordered_inlined(function: F) -> F:
    """As `inlined`, without reordering sums: rounding by adding a large constant depends on their order."""
    return _compiled(function, {**_ORDERED, **_INNER, "forceinline": True})


def exact_kernel(function: F) -> F:
    """Compile a function that Python calls, for the same bits as the same operations in NumPy."""
    return _compiled(function, _EXACT)


def exact_inlined(function: F) -> F:
    """As `inlined`, for kernels that are exact."""
    return _compiled(function, {**_EXACT, **_INNER, "forceinline": True})


def merged(function: F) -> F:
    """Compile a function that Numba inlines into the kernels that call it before it compiles them."""
    return _compiled(function, {**OPTIONS, **_INNER, "inline": "always"})


def _compiled(function: F, options: Mapping[str, Any]) -> F:
    """The function, compiled when it is first called; its signature stays, as Numba's dispatcher has the same call."""
    compiled: F = njit(**options)(function)
    return compiled
