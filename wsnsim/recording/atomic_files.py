"""Files that get their name only when they are complete.

write_atomically(place, write)        write_text_atomically(place, text)        temporary_beside(place, name)
sole_writer(place)
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from wsnsim.base.errors import UsageError
from wsnsim.recording.layout import cannot_write

TEMPORARY: Final = re.compile(r".*\.(?P<host>[^.]+)\.(?P<pid>\d+)(-\w+)?\.tmp")
"""Names of temporary files."""


def write_text_atomically(place: Path, text: str) -> None:
    """Write a text file as a whole or not at all. Raises StorageError."""
    write_atomically(place, lambda tmp: tmp.write_text(text, encoding="utf-8"))


def write_atomically(place: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary name, synchronise that file to the disk, and give it its name.

    Raises:
        StorageError: the file cannot be written. The temporary file is removed.
    """
    tmp = None
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        tmp = temporary_beside(place)
        write(tmp)
        with tmp.open("rb+") as file:
            os.fsync(file.fileno())
        tmp.replace(place)
    except OSError as error:
        if tmp is not None:
            with contextlib.suppress(OSError):
                tmp.unlink(missing_ok=True)
        raise cannot_write(place, error) from error


@contextlib.contextmanager
def sole_writer(place: Path) -> Iterator[None]:
    """Let one process of this machine at a time write a file: of those that ask here, the others are told.

    The lock is one of the kernel on `.NAME.lock` beside the file. It ends with the process: what a killed process left
    is a file without a lock, which the next writer takes and removes. Where there can be no lock, there is none.

    Raises:
        UsageError: another process is writing the file.
    """
    lock = place.with_name(f".{place.name}.lock")
    descriptor = None
    try:
        descriptor = _locked(lock)
    except BlockingIOError:
        said = "another run is writing this file: wait until it has ended, or name another file"
        raise UsageError(f"{place}: {said}") from None
    except OSError:  # such as a folder that does not exist, which the writer reports
        pass
    try:
        yield
    finally:
        if descriptor is not None:
            with contextlib.suppress(OSError):
                lock.unlink()
            os.close(descriptor)


def _locked(lock: Path) -> int:
    """The descriptor of the locked file. Raises BlockingIOError if another has locked it."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), lock.stat()):
                return descriptor
        except FileNotFoundError:  # its owner has just removed it
            pass
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)


def temporary_beside(place: Path, name: str | None = None) -> Path:
    """Create an empty file beside `place`, `NAME.host.pid-random.tmp`, and return its path.

    Nobody can foresee the name, and the file is new: where others may write, none of them can have put a link there.

    Args:
        place: The file that the temporary one becomes.
        name: The first part of the name; by default the name of `place`.

    Raises:
        OSError: It cannot be created.
    """
    while True:
        tmp = place.with_name(f"{name or place.name}.{host()}.{os.getpid()}-{secrets.token_hex(6)}.tmp")
        with contextlib.suppress(FileExistsError):
            tmp.touch(exist_ok=False)
            return tmp


def host() -> str:
    """The name of this machine, as it stands in names of files."""
    return re.sub(r"\W", "-", socket.gethostname().split(".")[0]) or "host"
