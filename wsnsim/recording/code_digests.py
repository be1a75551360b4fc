"""Digests of source files: those of this package, and those of plug-ins.

    package_digests() -> {"wsnsim/trackers/ekf.py": "3f2a..."}      what a run can execute
    module_digests("mylab.trackers") -> {"mylab/trackers.py": "9bc1..."}
    code_digest() -> str                                            the whole package with its data

Nothing is imported: a plug-in's files are found on Python's path.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.machinery
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

PACKAGE: Final = "wsnsim"
NOT_IN_A_RUN: Final = (
    "__main__.py", "analysis", "bounds", "campaign", "cli", "papers", "report", "testing", "verification",
)  # fmt: skip
"""What a run cannot import: the layers above `experiment`, see the import contracts."""
SUFFIXES: Final = (".py", ".yaml", ".so", ".pyd")
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
    package, they include what it imports from its own folder.
    """
    with contextlib.suppress(OSError, ValueError):
        files = _module_files(module)
        if not any(part in INSTALLED for path in files.values() for part in path.parts):
            files = _with_neighbours(files)
        return _digests(files)
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


def _module_files(module: str) -> dict[str, Path]:
    """The files of a module: those of the outermost regular package on its way, or its own."""
    top, *inner = module.split(".")
    spec = _spec(top)
    folders = [Path(folder) for folder in getattr(spec, "submodule_search_locations", None) or ()]
    if not folders:
        origin = Path(getattr(spec, "origin", None) or "")
        return {origin.name: origin} if origin.is_file() else {}
    for folder in folders:
        here = folder
        for name in inner:
            if (here / "__init__.py").is_file():
                break
            here = here / name
        if (here / "__init__.py").is_file():
            return dict(_below(here))
        if (file := here.with_suffix(".py")).is_file():
            return {file.name: file}
    return {}


def _spec(top: str) -> Any:
    with contextlib.suppress(Exception):  # finders of other packages, and names that no module can have
        loaded = getattr(sys.modules.get(top), "__spec__", None)
        return loaded or importlib.machinery.PathFinder.find_spec(top)
    return None


def _with_neighbours(files: Mapping[str, Path]) -> dict[str, Path]:
    """The files and, again and again, the modules beside them that they import."""
    found = dict(files)
    todo = list(files.items())
    while todo:
        name, path = todo.pop()
        folder = path.parents[name.count("/")]
        for top in _imported(path):
            new = dict(_beside(folder, top))
            todo += [(name, path) for name, path in new.items() if name not in found]
            found |= new
    return found


def _beside(folder: Path, top: str) -> Iterator[tuple[str, Path]]:
    if (folder / top / "__init__.py").is_file():
        yield from _below(folder / top)
    elif (file := folder / f"{top}.py").is_file():
        yield file.name, file


def _imported(path: Path) -> set[str]:
    """The first names of the modules that a file imports by absolute names."""
    if path.suffix != ".py":
        return set()
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return set()
    names = {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level}
    return {name.partition(".")[0] for name in names} - {PACKAGE, ""}
