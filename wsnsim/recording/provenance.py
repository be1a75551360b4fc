"""The provenance of a result: versions, commit, command, machine, and digests of source files, plug-ins' included.

    package_digests() -> {"wsnsim/trackers/ekf.py": "3f2a..."}      what a run can execute
    module_digests("mylab.trackers") -> {"mylab/trackers.py": "9bc1..."}
    code_digest() -> str                                            the whole package with its data

It is collected before a run starts. Nothing is imported: a plug-in's files are found on Python's path.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.machinery
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

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


PACKAGES: Final = (
    "wsnsim", "numpy", "scipy", "numba", "llvmlite", "simpy", "networkx", "h5py", "pandas", "pydantic", "pyyaml",
)  # fmt: skip

SETTINGS: Final = (
    "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX", "NUMBA_OPT", "NUMBA_DISABLE_JIT", "OPENBLAS_CORETYPE",
)  # fmt: skip
"""Variables of the environment that choose machine code, and therefore last bits, on the same processor."""


def provenance(
    command_line: str, seed: int, plugins: Sequence[str] = (), overrides: Sequence[str] = ()
) -> dict[str, Any]:
    """The provenance as a dict that can be written as JSON.

    It holds versions, the git commit if wsnsim runs from a checkout, seed, command line, plug-ins, the assignments that
    changed the scenario's text, platform and start time (UTC). `cpu_features` are the instruction sets that NumPy
    uses, the processor, and environment variables that select other instruction sets: log, exp and sums differ in the
    last bit between them, so equal bits are guaranteed for equal features only. No path, user or host name is stored,
    except those in the command line and in the assignments.
    """
    return {
        "command_line": command_line,
        "seed": seed,
        "plugins": list(plugins),
        "overrides": list(overrides),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES} | {"hdf5": h5py.version.hdf5_version},
        "git": _own_checkout(),
        "platform": _platform(),
        "machine": platform.machine(),
        "cpu_features": list(cpu_features()),
        "start": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _platform() -> str:
    """What `platform.platform()` says on Linux, without the process `uname -p` that it starts."""
    libc = "".join(platform.libc_ver())
    return "-".join([platform.system(), platform.release(), platform.machine(), *(["with", libc] if libc else [])])


@functools.cache
def cpu_features() -> tuple[str, ...]:
    """What decides the last bits of results on this machine, besides the versions of the packages.

    First the instruction sets that NumPy uses, without those that NPY_DISABLE_CPU_FEATURES switches off. Then the name
    of the processor, such as 'znver4', as LLVM knows it: processors with the same instruction sets have different names
    if LLVM orders or joins operations differently for them, and libraries choose their code by the processor even where
    kernels are compiled for another one. Last come the environment's settings in `SETTINGS`, as 'NAME=value'.
    """
    from llvmlite import binding

    config = np.show_config(mode="dicts")
    extensions = config.get("SIMD Extensions", {}) if config else {}
    settings = (f"{name}={os.environ[name]}" for name in SETTINGS if name in os.environ)
    return (*extensions.get("baseline", []), *extensions.get("found", []), str(binding.get_host_cpu_name()), *settings)


@functools.cache
def _version(package: str) -> str | None:
    """The version of an installed package. The rest of its metadata is not parsed: a run would notice the time."""
    try:
        installed = distribution(package)
    except PackageNotFoundError:
        return None
    line = re.search(r"^Version:[ \t]*(\S+)", installed.read_text("METADATA") or "", re.MULTILINE)
    return line[1] if line else installed.version


@functools.cache
def _own_checkout() -> Mapping[str, Any] | None:
    """The checkout of this package. It is read once per process, because the modules were loaded from that commit."""
    return _checkout(Path(__file__).resolve().parents[2])


def _checkout(root: Path) -> dict[str, Any] | None:
    """The commit, and whether tracked files differ from it; None outside a git checkout or without git."""
    if not (root / ".git").exists():
        return None
    commit = _git(root, "rev-parse", "HEAD")
    changes = _git(root, "status", "--porcelain", "--untracked-files=no")
    return None if commit is None or changes is None else {"commit": commit, "dirty": bool(changes)}


def committed(folder: Path, *patterns: str) -> tuple[str, float] | None:
    """The last commit of the files of a folder, and its time (s); None if they differ from it, or there is no git."""
    found = _git(folder, "log", "-1", "--format=%H %ct", "--", *patterns)
    if not found or _git(folder, "status", "--porcelain", "--", *patterns) != "":
        return None
    commit, _, time = found.partition(" ")
    return commit, float(time)


def _git(root: Path, *arguments: str) -> str | None:
    # in a hook, GIT_DIR and others name the repository of the hook; GIT_CONFIG… may say which checkouts are safe
    ours = {name: value for name, value in os.environ.items() if not name.startswith("GIT_") or "CONFIG" in name}
    environment = ours | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    command = ["git", "-C", str(root), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, env=environment, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
