"""Files: which paths are regular files, their content and digests, tables beside the code, and folders for caches.

why_not_regular(path) -> str        read_regular(path, largest) -> bytes        file_digest(path) -> str
content_digest(path) -> 'sha256:…', the same for a file that is compressed again

A pipe would be waited for for ever, and a device need not end; a small file of gzip data may hold gigabytes.

Folders for caches are needed where home and installation cannot be written, as in containers and on clusters. Compiled
code in a cache is run as it is found there: the folder in the temporary directory is used only if nobody else can have
put files into it.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import stat
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, final

from wsnsim.base.version import __version__

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
    import gzip  # few runs read compressed files

    return io.BufferedReader(_Limited(gzip.GzipFile(fileobj=file)))


@final
class _Limited(io.RawIOBase):
    """Decompressed content that ends with an error where there is too much of it."""

    def __init__(self, content: Any) -> None:
        self._content, self._left = content, MOST_BYTES

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read into the buffer, and return the number of bytes. Raises OSError beyond `MOST_BYTES`."""
        count: int = self._content.readinto(buffer)
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


class Section(NamedTuple):
    """A section of a table: the cells of its heading, and the cells of its rows."""

    heading: tuple[str, ...]
    rows: list[tuple[str, ...]]


def read_sections(path: Path) -> list[Section]:
    """Return the sections of a file.

    A line '= cell | cell' begins a section, any other line is a row 'cell | cell'; '-' is an empty cell. An indented
    line continues the one above it; empty lines and lines that begin with '#' are left out.
    """
    found: list[Section] = []
    for line in path.read_text(encoding="utf-8").replace("\n    ", " ").splitlines():
        if line.startswith("= "):
            found.append(Section(_cells(line[2:]), []))
        elif line and not line.startswith("#"):
            found[-1].rows.append(_cells(line))
    return found


def _cells(line: str) -> tuple[str, ...]:
    return tuple("" if cell == "-" else cell for cell in line.split(" | "))


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
