"""The provenance of a result: versions, commit, command and machine, collected before a run starts."""

from __future__ import annotations

import functools
import os
import platform
import re
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

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
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpu_features": list(cpu_features()),
        "start": datetime.now(UTC).isoformat(timespec="seconds"),
    }


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
