"""Digests of source files: those of this package, and those of plug-ins.

    package_digests() -> {"wsnsim/trackers/ekf.py": "3f2a..."}      what a run can execute
    module_digests("mylab.trackers") -> {"mylab/trackers.py": "9bc1..."}
    code_digest() -> str                                            the whole package with its data

Nothing is imported: a plug-in's files are found on Python's path.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.machinery
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from wsnsim.base.plugin_code import NOT_PYTHON, statements

PACKAGE: Final = "wsnsim"
NOT_IN_A_RUN: Final = (
    "__main__.py", "analysis", "api", "bounds", "campaign", "cli", "fitting", "papers", "report", "testing",
    "verification", "watch",
)  # fmt: skip
"""What a run cannot import: the layers above `experiment`, see the import contracts."""
SUFFIXES: Final = (".py", ".table", ".yaml", ".so", ".pyd")
"""Files whose content counts."""
INSTALLED: Final = ("site-packages", "dist-packages")


@functools.cache
def package_digests() -> Mapping[str, str]:
    """{file: digest} of the files of this package that can change a run.

    They are read once per process, because the modules were loaded from them.
    """
    root = _root()
    return _digests({name: path for name, path in _below(root) if name.split("/")[1] not in NOT_IN_A_RUN})


@functools.cache
def code_digest() -> str:
    """A digest of the package's code and data, and of the versions of NumPy and SciPy."""
    import numpy as np
    import scipy

    return digest_of([np.__version__, scipy.__version__, *sorted(_digests(dict(_below(_root()))).items())])


def module_digests(module: str) -> dict[str, str]:
    """{file: digest} of the files of a plug-in's module; {} if it is not found.

    They are the whole package that the module belongs to, or the one file. Where the plug-in is not an installed
    package, they include what it imports from its own folder of Python's path, by absolute or relative names.
    """
    with contextlib.suppress(OSError, ValueError):
        root, files = _module_files(module)
        if not any(part in INSTALLED for path in files for part in path.parts):
            files = _with_neighbours(root, files)
        return _digests({path.relative_to(root).as_posix(): path for path in files})
    return {}


def digest_of(values: Iterable[Any]) -> str:
    """A digest of values, by their representation."""
    return hashlib.blake2b(repr(list(values)).encode(), digest_size=8).hexdigest()


def _root() -> Path:
    return Path(__file__).resolve().parents[1]


def _digests(files: Mapping[str, Path]) -> dict[str, str]:
    return {name: hashlib.blake2b(files[name].read_bytes(), digest_size=8).hexdigest() for name in sorted(files)}


def _below(folder: Path) -> Iterator[tuple[str, Path]]:
    """The files of a package by name, such as wsnsim/trackers/ekf.py."""
    for path in folder.rglob("*"):
        if path.suffix in SUFFIXES and path.is_file():
            yield f"{folder.name}/{path.relative_to(folder).as_posix()}", path


def _module_files(module: str) -> tuple[Path, list[Path]]:
    """The folder in which a module's first name is, and the module's files: see `_found`."""
    top, *inner = module.split(".")
    spec = _spec(top)
    folders = [Path(folder) for folder in getattr(spec, "submodule_search_locations", None) or ()]
    if not folders:
        origin = Path(getattr(spec, "origin", None) or "")
        return origin.parent, [origin] if origin.is_file() else []
    for folder in folders:
        files = _of_package(folder) if (folder / "__init__.py").is_file() else _found(folder, inner)
        if files:
            return folder.parent, files
    return Path(), []


def _found(folder: Path, names: Sequence[str]) -> list[Path]:
    """The files of a module below a folder: those of the outermost regular package on its way, or its own."""
    for name in names:
        if (folder / name / "__init__.py").is_file():
            return _of_package(folder / name)
        if (file := folder / f"{name}.py").is_file():
            return [file]
        folder = folder / name
    return []


def _of_package(folder: Path) -> list[Path]:
    return [path for _, path in _below(folder)]


def _spec(top: str) -> Any:
    with contextlib.suppress(Exception):  # finders of other packages, and names that no module can have
        loaded = getattr(sys.modules.get(top), "__spec__", None)
        return loaded or importlib.machinery.PathFinder.find_spec(top)
    return None


def _with_neighbours(root: Path, files: Iterable[Path]) -> list[Path]:
    """The files and, again and again, the modules below the root that they import."""
    found = dict.fromkeys(files)
    todo = list(found)
    while todo:
        path = todo.pop()
        for level, names in _imported(path):
            folder = path.parents[level - 1] if level else root
            if not folder.is_relative_to(root):
                continue
            new = [file for file in _found(folder, names) if file not in found]
            todo += new
            found |= dict.fromkeys(new)
    return list(found)


def _imported(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The modules that a file imports, as (dots before a relative name, names), and what it imports from them."""
    if path.suffix != ".py":
        return
    with contextlib.suppress(*NOT_PYTHON):
        for statement in statements(path.read_bytes()):
            yield from _imports(statement[0].string, " ".join(token.string for token in statement[1:]))


def _imports(keyword: str, rest: str) -> Iterator[tuple[int, list[str]]]:
    """The same for one statement, whose tokens after the first have a space between them."""
    if keyword == "import":
        yield from ((0, name.split(".")) for name in _names(rest) if name.partition(".")[0] != PACKAGE)
    elif keyword == "from":
        source, _, names = rest.partition(" import ")
        dotted = source.replace(" ", "")
        module = dotted.lstrip(".")
        level = len(dotted) - len(module)
        if level or module.partition(".")[0] != PACKAGE:
            yield from ((level, [*module.split("."), name] if module else [name]) for name in _names(names))


def _names(listed: str) -> list[str]:
    """["a.b", "c"] of "a . b as x , c", without brackets around it."""
    names = (name.partition(" as ")[0] for name in listed.strip("() ").split(","))
    return [name.replace(" ", "") for name in names if name.strip()]
