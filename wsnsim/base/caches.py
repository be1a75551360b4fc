"""Folders for caches where home and installation cannot be written, as in containers and on clusters.

Compiled code in a cache is run as it is found there. The folder in the temporary directory is therefore used only if
nobody else can have put files into it.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import Final

from wsnsim.base.version import __version__

VARIABLE: Final = "WSNSIM_CACHE"
"""The environment variable that names the folder for caches."""


class CacheWarning(UserWarning):
    """Compiled kernels are not kept where they are usually kept."""


def wished_folder() -> Path | None:
    """The folder of this version in the one that WSNSIM_CACHE names, created; None if the variable is not set.

    Raises:
        OSError: it cannot be written.
    """
    wish = os.environ.get(VARIABLE)
    return _writable(Path(wish).absolute() / __version__) if wish else None


def private_folder() -> Path:
    """The folder for caches in the temporary directory, of this user and this version; created with mode 0700.

    Raises:
        OSError: it cannot be written, belongs to somebody else, or others can replace it or write into it.
    """
    import tempfile  # as below: slow to import

    parent = Path(tempfile.gettempdir())
    owner = f"-{os.getuid()}" if hasattr(os, "getuid") else ""
    path = parent / f"wsnsim{owner}-{__version__}"
    path.mkdir(mode=0o700, exist_ok=True)
    if hasattr(os, "getuid"):  # on Windows, each user has a temporary directory
        _demand_nobody_else(path, path.lstat(), (os.getuid(),))
        about = parent.stat()
        if not about.st_mode & stat.S_ISVTX:  # others can rename what is in it
            _demand_nobody_else(parent, about, (os.getuid(), 0))
    return _writable(path)


def prepare_matplotlib() -> None:
    """Let Matplotlib use our folder for caches if it has none of its own: it would list all fonts again every time.

    Where there is no such folder, Matplotlib makes a temporary one itself.
    """
    if os.environ.get("MPLCONFIGDIR") or sys.platform == "win32" or all(map(_can_be_written, _matplotlib_folders())):
        return
    try:
        folder = wished_folder() or private_folder()
        os.environ["MPLCONFIGDIR"] = str(_writable(folder / "matplotlib"))
    except OSError:
        return


def reason(error: OSError) -> str:
    """Why a folder cannot be used, with its name."""
    return f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error)


def _writable(path: Path) -> Path:
    """The folder, created where needed. Raises OSError if no file can be created in it."""
    import tempfile

    path.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=path).close()
    return path


def _demand_nobody_else(path: Path, about: os.stat_result, owners: tuple[int, ...]) -> None:
    """Raise PermissionError unless this is a folder of one of the owners that nobody else can write to."""
    if not stat.S_ISDIR(about.st_mode):
        raise NotADirectoryError(20, "is no folder", str(path))
    if about.st_uid not in owners:
        raise PermissionError(13, "belongs to another user", str(path))
    if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(13, "can be written by others", str(path))


def _matplotlib_folders() -> list[Path]:
    """Where Matplotlib keeps its settings and its caches if no variable says otherwise."""
    try:
        home = Path.home()
    except RuntimeError:  # a user without a home, as in containers
        return [Path(os.devnull)]
    if not sys.platform.startswith(("linux", "freebsd")):
        return [home / ".matplotlib"]
    bases = (("XDG_CONFIG_HOME", ".config"), ("XDG_CACHE_HOME", ".cache"))
    return [Path(os.environ.get(name) or home / usual) / "matplotlib" for name, usual in bases]


def _can_be_written(path: Path) -> bool:
    """Whether the folder, or the nearest one above it that exists, is a folder that this user can write to."""
    try:
        while not path.exists():
            path = path.parent
        return path.is_dir() and os.access(path, os.W_OK | os.X_OK)
    except OSError:
        return False
