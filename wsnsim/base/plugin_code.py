"""The code of plug-ins: a callback before it is imported, the place of an error in it, and its statements.

Statements are read as tokens: CPython before 3.11.8 and 3.12.2 raises SystemError where two threads call `ast.parse` at
the same time (https://github.com/python/cpython/issues/106905), and threads of users may call it at any time. A parser
would also print the warnings of a file each time.
"""

from __future__ import annotations

import contextlib
import contextvars
import inspect
import io
import os
import tokenize
from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path
from types import FrameType, GeneratorType
from typing import Any, Final, NamedTuple, cast

TRACEBACK_HINT: Final = "set WSNSIM_TRACEBACK=1 for the traceback"
_PACKAGE: Final = str(Path(__file__).parents[1]) + os.sep
_LIBRARY: Final = str(Path(os.__file__).parent) + os.sep
_INSTALLED: Final = (f"{os.sep}site-packages{os.sep}", f"{os.sep}dist-packages{os.sep}")
_MODULES: Final[set[str]] = set()
"""The modules of plug-ins that were imported."""


class PluginImport(NamedTuple):
    """A plug-in that is about to be imported: its role and kind, its module, and the module's file ('' if unknown)."""

    role: str
    kind: str
    module: str
    file: str


_WATCHER: Final[contextvars.ContextVar[Callable[[PluginImport], None] | None]] = contextvars.ContextVar(
    "watcher of imports", default=None
)


@contextlib.contextmanager
def watching_imports(watcher: Callable[[PluginImport], None]) -> Iterator[None]:
    """Call the watcher with every plug-in before it is imported."""
    token = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(token)


def announce(plugin: PluginImport) -> None:
    """Tell the watcher of a plug-in that is about to be imported, here or in another process."""
    watcher = _WATCHER.get()
    if watcher is not None:
        watcher(plugin)


def note_plugin(module: str) -> None:
    """Note that a module, and its neighbours in its package, are code of a plug-in."""
    if module.partition(".")[0] != "wsnsim":
        _MODULES.add(module)


def plugin_fault(error: BaseException) -> str:
    """Return where in a plug-in an error arose, and the error: 'mylab.py:31: KeyError: 3'; '' if it did not.

    The place is the deepest line that belongs neither to wsnsim nor to Python nor to an installed library, unless the
    plug-in itself is installed.
    """
    for one in _chain(error):
        place = getattr(one, "place", "") or _place(one)
        if place and (said := getattr(one, "said", "")):  # a PluginAnswerError, which says it in words
            return f"{place}: {said}"
        if place:
            message = " ".join(str(one.msg if isinstance(one, SyntaxError) else one).split())
            return f"{place}: {type(one).__name__}" + (f": {message}" if message else "")
    return ""


def plugin_place(error: BaseException) -> str:
    """Return the deepest line of a plug-in's code in the traceback of an error, such as 'mylab.py:31'; '' without."""
    return next(filter(None, map(_place, _chain(error))), "")


def code_place(kind: type, name: str) -> str:
    """Return the file and line where the code of a plug-in defines a method, or else the class itself."""
    code = getattr(inspect.unwrap(getattr(kind, name, kind)), "__code__", None)
    if code is not None and _is_foreign(code.co_filename):
        return f"{_short(code.co_filename)}:{code.co_firstlineno}"
    try:
        return f"{_short(inspect.getfile(kind))}:{inspect.getsourcelines(kind)[1]}"
    except (OSError, TypeError):  # a class without a file, as in a notebook
        return f"{kind.__module__}:{kind.__qualname__}"


def line_place(flow: Generator[Any, Any, Any]) -> str:
    """Return the file and line at which a generator waits: that of the deepest one which a plug-in's code runs."""
    place, inner = "", cast(Any, flow)
    while isinstance(inner, GeneratorType) and inner.gi_frame is not None:
        file = inner.gi_frame.f_code.co_filename
        place = f"{_short(file)}:{inner.gi_frame.f_lineno}" if not place or _is_foreign(file) else place
        inner = inner.gi_yieldfrom
    return place


def plugin_classes(components: Iterable[object]) -> list[str]:
    """Return the classes of plug-ins among those of components, and of tuples of components: 'mylab:Mine' each."""
    flat = (part for value in components for part in (value if isinstance(value, tuple) else (value,)))
    return [
        f"{kind.__module__}:{kind.__qualname__}"
        for kind in dict.fromkeys(map(type, flat))
        if _is_in_plugin(kind.__module__)
    ]


def _chain(error: BaseException) -> Iterator[BaseException]:
    """Yield the error, and what it was raised from."""
    seen = set()
    cause: BaseException | None = error
    while cause is not None and id(cause) not in seen:
        seen.add(id(cause))
        yield cause
        cause = cause.__cause__


def _place(error: BaseException) -> str:
    if isinstance(error, SyntaxError) and error.filename and _is_foreign(error.filename):
        return f"{_short(error.filename)}:{error.lineno}"
    import traceback  # slow to import, and needed only where something failed

    frames = list(traceback.walk_tb(error.__traceback__))
    if not any(_is_plugin(frame) for frame, _ in frames):
        return ""
    frame, line = next(
        pair for pair in reversed(frames) if _is_plugin(pair[0]) or _is_foreign(pair[0].f_code.co_filename)
    )
    return f"{_short(frame.f_code.co_filename)}:{line}"


def _is_plugin(frame: FrameType) -> bool:
    return _is_in_plugin(str(frame.f_globals.get("__name__", "")))


def _is_in_plugin(name: str) -> bool:
    return any(name == module or name.startswith(f"{module.rpartition('.')[0] or module}.") for module in _MODULES)


def _is_foreign(file: str) -> bool:
    """Whether a file belongs neither to wsnsim nor to Python nor to an installed library."""
    return not (file.startswith(("<", _PACKAGE, _LIBRARY)) or any(part in file for part in _INSTALLED))


def _short(file: str) -> str:
    """Return the path from the working directory, if the file is in it."""
    try:
        path = os.path.relpath(file)
    except (OSError, ValueError):  # the working directory is gone, or on another drive
        return file
    return file if path.startswith("..") else path


NOT_PYTHON: Final = (SyntaxError, ValueError, tokenize.TokenError)
"""What `statements` raises where it finds that a file is not Python."""


def statements(source: bytes) -> Iterator[list[tokenize.TokenInfo]]:
    """The names and operators of each simple statement, and of each header of a compound statement up to its colon."""
    tokens: list[tokenize.TokenInfo] = []
    depth = 0
    for token in tokenize.tokenize(io.BytesIO(source).readline):
        ends = token.type == tokenize.NEWLINE
        if token.type == tokenize.OP:
            depth += (token.string in {"(", "[", "{"}) - (token.string in {")", "]", "}"})
            ends = not depth and token.string in {";", ":"}
        if ends and tokens:
            yield tokens
            tokens = []
        elif not ends and token.type in {tokenize.NAME, tokenize.OP}:
            tokens.append(token)
