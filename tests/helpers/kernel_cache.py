"""Where compiled kernels are kept while tests run, and from one run of the tests to the next."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path


def kernel_cache(root: Path, environment: Path) -> Path:
    """The folder for compiled kernels: one of the sources in the clone's own virtual environment, else a temporary one.

    Numba compiles a kernel again when its file changes, but not when a function that it inlines changes in another
    file. Therefore each state of all kernels has a folder of its own, and those of former states are removed. In it,
    each processor that NUMBA_CPU_NAME names has its own.
    """
    if not environment.is_relative_to(root):
        return Path(tempfile.mkdtemp(prefix="wsnsim-numba-"))
    digest = hashlib.sha256(f"{sys.version} {version('numba')} {version('numpy')}".encode())
    for source in sorted((root / "wsnsim" / "kernels").glob("*.py")):
        digest.update(source.read_bytes())
    state = environment / "kernels-of-tests" / digest.hexdigest()[:16]
    for former in state.parent.glob("*"):
        if former != state:
            shutil.rmtree(former, ignore_errors=True)
    folder = state / os.environ.get("NUMBA_CPU_NAME", "host")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def lasting_cache(root: Path, environment: Path) -> Path:
    """The folder for programs that remove none: in the clone's environment, else in its folder of builds."""
    return kernel_cache(root, environment if environment.is_relative_to(root) else root / "build")


if __name__ == "__main__":
    print(lasting_cache(Path(__file__).parents[2], Path(sys.prefix)))
