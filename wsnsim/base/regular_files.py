"""Which paths can be read as files: a pipe would wait for ever, and a device need not end.

why_not_regular(path) -> str        read_regular(path, largest) -> bytes        file_digest(path) -> str
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Final

KINDS: Final[tuple[tuple[Callable[[int], bool], str], ...]] = (
    (stat.S_ISDIR, "is a folder"),
    (stat.S_ISFIFO, "is a pipe"),
    (stat.S_ISSOCK, "is a socket"),
    (stat.S_ISCHR, "is a device"),
    (stat.S_ISBLK, "is a device"),
)
LARGEST_NAME: Final = 255
"""Bytes of the longest file name of common file systems."""
LONGEST_ADDITION: Final = 105
"""Bytes by which a temporary name is longer: '.h5', host (63 at most), process id, random digits, '.tmp'."""


def why_not_regular(path: str | Path) -> str:
    """Why a path is no regular file, such as 'is a pipe, not a regular file'; '' if it is one, or does not exist."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return ""
    if stat.S_ISREG(mode):
        return ""
    found = next((words for holds, words in KINDS if holds(mode)), "is no file")
    return f"{found}, not a regular file"


def read_regular(path: str | Path, largest: int | None = None) -> bytes:
    """The content of a regular file.

    Args:
        path: the file.
        largest: bytes after which reading stops; None for no limit.

    Raises:
        OSError: the path is not a regular file, or cannot be read.
    """
    if reason := why_not_regular(path):
        raise OSError(errno.EINVAL, reason, str(path))
    with Path(path).open("rb") as file:
        return file.read(-1 if largest is None else largest)


def file_digest(path: str | Path) -> str:
    """The digest of a regular file's content: 16 hexadecimal digits (BLAKE2b).

    Raises:
        OSError: the path is not a regular file, or cannot be read.
    """
    if reason := why_not_regular(path):
        raise OSError(errno.EINVAL, reason, str(path))
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=8)).hexdigest()
    except ValueError as error:  # a name that no file can have
        raise OSError(errno.EINVAL, str(error), str(path)) from error


def is_too_long(name: str) -> bool:
    """Whether a file of this name cannot have a temporary name beside it: see `LARGEST_NAME`."""
    return len(os.fsencode(name)) + LONGEST_ADDITION > LARGEST_NAME
