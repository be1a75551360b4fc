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

A kernel that several processes need at the same time is compiled by one of them; the others wait, and load it.
Numba keeps compiled kernels beside the sources, or in the user's cache. Where it can write neither, they are kept in a
private folder of the temporary directory, or not at all. WSNSIM_CACHE names another folder.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar, final

from numba import config, njit
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock

from wsnsim.base.files import VARIABLE, CacheWarning, private_folder, reason, wished_folder

F = TypeVar("F", bound=Callable[..., Any])
BLAS: Final = "scipy.linalg.cython_blas"
USER_CACHE: Final = "XDG_CACHE_HOME"
PATIENCE: Final = 60.0
"""Seconds for which a process waits at most while another one compiles a kernel. Our kernels compile within 2 s."""
POLL: Final = 0.02
"""Seconds between two attempts to take the lock."""


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


def _use_wished_folder() -> None:
    """Keep compiled kernels in the folder that WSNSIM_CACHE names. Say so if it cannot be written."""
    try:
        folder = wished_folder()
    except OSError as error:
        _warn(f"{VARIABLE}: {reason(error)}; compiled kernels are kept where they are without it")
    else:
        if folder:
            _use(folder)


@functools.cache
def _has_private_folder() -> bool:
    """Keep compiled kernels in the temporary directory; whether that is possible. It is said once."""
    try:
        folder = private_folder()
    except OSError as error:
        _warn(
            f"compiled kernels cannot be kept ({reason(error)}), so that every process compiles them again; set"
            f" {VARIABLE} to a folder that only you can write to"
        )
        return False
    _use(folder)
    _warn(
        f"compiled kernels are kept in {folder}, because neither the installation nor the user's cache can be written;"
        f" {VARIABLE} names another folder"
    )
    return True


def _use(folder: Path) -> None:
    """Let Numba keep compiled code in the folder, in this process and in those that it starts."""
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    config.reload_config()  # type: ignore[no-untyped-call]


@contextlib.contextmanager
def _no_folder_named_tilde() -> Iterator[None]:
    """Let Numba find that it cannot write to the user's cache if the user has no home.

    Where neither HOME is set nor the system knows the user, as in containers, it would make a folder '~' in the working
    directory.
    """
    if os.environ.get(USER_CACHE) or os.path.expanduser("~") != "~":  # noqa: PTH111 (Path raises)
        yield
        return
    os.environ[USER_CACHE] = os.devnull
    try:
        yield
    finally:
        del os.environ[USER_CACHE]


def _warn(message: str) -> None:
    """Warn once per command: not in its worker processes."""
    import multiprocessing

    if multiprocessing.parent_process() is None:
        warnings.warn(message, CacheWarning, stacklevel=3)


_use_wished_folder()


@final
class _ForgivingCache(FunctionCache):
    """Compiled code on disk, without which a kernel is compiled: a damaged file or a full disk ends no run."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel; None if this process must compile it. If another one does so, wait for it."""
        found = self._load(sig, target_context)
        lock = Path(self._cache_file._index_path).with_suffix(".lock")
        if found is None and _CALLS and lock not in _HELD:
            with contextlib.suppress(ImportError, OSError):
                _acquire(lock, _CALLS[-1])
                found = self._load(sig, target_context)
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel; None if there is none, or if it cannot be read."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # whatever damaged pickles raise
            with contextlib.suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled kernel, if it can be written."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


@final
class CompilationTime(event.Listener):
    """The processor time in which this process has compiled kernels. Loading a cached kernel is not compiling.

    Attributes:
        seconds: Processor time (s) until now.
        wall: Real time (s) until now, also while other processes compiled what this one needs.
        announce: Called when a compilation begins.
    """

    def __init__(self) -> None:
        self.seconds = self.wall = 0.0
        self.announce: Callable[[], None] | None = None
        self._depth = 0
        self._began = self._began_wall = 0.0

    def on_start(self, event: event.Event) -> None:
        """A kernel is compiled, perhaps because another one that is being compiled calls it."""
        if not self._depth:
            self._began, self._began_wall = time.process_time(), time.monotonic()
            if self.announce is not None:
                self.announce()
        self._depth += 1

    def add_wait(self, seconds: float) -> None:
        """Add the seconds spent waiting for another process's compilation."""
        if not self._depth:
            self.wall += seconds

    def on_end(self, event: event.Event) -> None:
        """A kernel is compiled, or cannot be."""
        self._depth -= 1
        if not self._depth:
            self.seconds += time.process_time() - self._began
            self.wall += time.monotonic() - self._began_wall


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
    compiled: F
    try:
        with _no_folder_named_tilde():
            compiled = njit(**options)(function)
    except RuntimeError:  # Numba has found no folder that can be written
        compiled = njit(**{**options, "cache": _has_private_folder()})(function)
    cache = getattr(compiled, "_cache", None)
    if type(cache) is FunctionCache:
        cache.__class__ = _ForgivingCache  # making another one would look for the folder a second time
        compiled.compile = functools.partial(_compiled_once, compiled.compile)  # type: ignore[attr-defined]
    return compiled


_HELD: Final[set[Path]] = set()
"""Lock files that this process holds while nested kernels are compiled."""
_CALLS: Final[list[contextlib.ExitStack]] = []
"""What each call of `compile` that is going on releases at its end; a kernel compiles those that it calls."""


def _compiled_once(compile_: Callable[[Any], Any], signature: Any) -> Any:
    """Load a kernel, or compile it unless another process does so: then wait until it is there to be loaded.

    Processes never wait for each other in a circle, because kernels do not call each other in circles.
    """
    with global_compiler_lock, contextlib.ExitStack() as held:
        _CALLS.append(held)
        held.callback(_CALLS.pop)
        return compile_(signature)


def _acquire(lock: Path, held: contextlib.ExitStack) -> None:
    """Lock the file until `held` ends; after PATIENCE seconds return without the lock.

    Raises:
        ImportError: the system has no such locks.
        OSError: the folder cannot be written, or its file system has no locks.
    """
    import fcntl

    began = time.monotonic()
    file = held.enter_context(lock.open("wb"))
    while time.monotonic() - began < PATIENCE:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(POLL)
        else:
            held.callback(fcntl.flock, file, fcntl.LOCK_UN)  # a process that was forked meanwhile keeps the file open
            break
    _HELD.add(lock)
    held.callback(_HELD.remove, lock)
    COMPILATION_TIME.add_wait(time.monotonic() - began)
