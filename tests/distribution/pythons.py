"""The Pythons that are installed on this machine, and the folder of the project."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

HOME = Path(__file__).parents[2]


def version_of(python: str) -> tuple[int, int] | None:
    """(major, minor) of a Python, None if it does not start."""
    code = "import sys; print(*sys.version_info[:2])"
    try:
        answer = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    major, minor = map(int, answer.split())
    return major, minor


def interpreter(version: str) -> str | None:
    """The Python of a version such as `3.12`, on the path or among those of pyenv; None if none starts."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    found = [shutil.which(f"python{version}"), *sorted(map(str, pyenv.glob(f"versions/{version}.*/bin/python")))]
    wanted = tuple(map(int, version.split(".")))
    return next((python for python in found if python and version_of(python) == wanted), None)
