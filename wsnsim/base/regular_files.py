"""Files that are read: which paths are regular files, what gzip data holds up to a limit, and digests of contents.

why_not_regular(path) -> str        read_regular(path, largest) -> bytes        file_digest(path) -> str
content_digest(path) -> 'sha256:…', the same for a file that is compressed again

A pipe would be waited for for ever, and a device need not end; a small file of gzip data may hold gigabytes.
"""

from __future__ import annotations

import errno
import gzip
import hashlib
import io
import os
import stat
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, Final, final

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


MAGIC: Final = b"\x1f\x8b"
"""The first bytes of gzip data."""
MOST_BYTES: Final = 200_000_000
"""Greatest size of the content of a compressed file (our choice): about eight million readings."""


def decompressed(file: BinaryIO) -> io.BufferedReader:
    """The content of gzip data; reading beyond `MOST_BYTES` is an OSError."""
    return io.BufferedReader(_Limited(gzip.GzipFile(fileobj=file)))


@final
class _Limited(io.RawIOBase):
    """Decompressed content that ends with an error where there is too much of it."""

    def __init__(self, content: gzip.GzipFile) -> None:
        self._content, self._left = content, MOST_BYTES

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read into the buffer, and return the number of bytes. Raises OSError beyond `MOST_BYTES`."""
        count = self._content.readinto(buffer)
        self._left -= count
        if self._left < 0:
            limit = f"more than {MOST_BYTES // 10**6} MB when decompressed"
            raise OSError(f"it is {limit}; decompress it first if it is so large")
        return count


def content_digest(path: str | Path) -> str:
    """'sha256:' and the digest of a file's content, decompressed if it is gzip: a file packed again has the same one.

    Raises:
        OSError: the path is not a regular file, it cannot be read, its gzip data is damaged or holds too much.
    """
    data = read_regular(path)
    content = io.BytesIO(data)
    try:
        file = decompressed(content) if data.startswith(MAGIC) else content
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"
    except (EOFError, zlib.error) as error:
        raise OSError(f"its gzip data is damaged or cut off ({error})") from error
