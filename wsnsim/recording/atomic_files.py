"""Files that get their name only when they are complete, and what killed processes left in a campaign's folder.

write_atomically(place, write)        write_text_atomically(place, text)        temporary_beside(place, name)
sole_writer(place)                    remove_leftovers(folder)

Whether a process of this machine lives can be asked. Of another machine's process only its files are known: they are
removed when they were not written for a day. If the process is alive after all, no result is lost or changed: a task
whose temporary file is gone is not stored, and is run again.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from wsnsim.base.errors import StorageError, UsageError

TEMPORARY: Final = re.compile(r".*\.(?P<host>[^.]+)\.(?P<pid>\d+)(-\w+)?\.tmp")
"""Names of temporary files."""


def reason(error: BaseException) -> str:
    """The part of an error of HDF5 or of the operating system that tells a user what to do."""
    text = str(error)
    quoted = re.search(r"error message = '([^']*+)'", text)
    if quoted:
        return quoted[1]
    if isinstance(error, OSError) and error.strerror and "(" not in error.strerror:
        return error.strerror
    bracketed = text.partition("(")[2].rpartition(")")[0]
    return bracketed or text or type(error).__name__


def cannot_write(path: Path, error: BaseException) -> StorageError:
    """The error of a result that cannot be written, with the reason."""
    return StorageError(f"{path}: cannot be written: {reason(error)}")


def write_text_atomically(place: Path, text: str) -> None:
    """Write a text file as a whole or not at all. Raises StorageError."""
    write_atomically(place, lambda tmp: tmp.write_text(text, encoding="utf-8"))


def write_atomically(place: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary name, synchronise that file to the disk, and give it its name.

    Raises:
        StorageError: the file cannot be written. The temporary file is removed.
    """
    with replacing(place, with_folder=True) as tmp:
        write(tmp)


@contextlib.contextmanager
def replacing(place: Path, name: str | None = None, with_folder: bool = False) -> Iterator[Path]:
    """The path of a temporary file, which gets the name `place` when it is complete, and is removed if it is not.

    Args:
        place: the file.
        name: the first part of the temporary name, as of `temporary_beside`.
        with_folder: whether the folder is created.

    Raises:
        StorageError: the file cannot be written, or has no folder.
    """
    try:
        if with_folder:
            place.parent.mkdir(parents=True, exist_ok=True)
        tmp = temporary_beside(place, name)
        try:
            yield tmp
            _synchronise(tmp)
            tmp.replace(place)
            with contextlib.suppress(OSError):  # some file systems do not synchronise folders
                _synchronise(place.parent)
        finally:
            with contextlib.suppress(OSError):
                tmp.unlink(missing_ok=True)
    except (OSError, RuntimeError) as error:  # HDF5 raises both
        raise cannot_write(place, error) from error


def _synchronise(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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


ABANDONED: Final = 86_400.0
"""Seconds after which a file of another machine's process is removed if it was not written."""


def remove_leftovers(folder: Path) -> None:
    """Remove files of dead processes of this machine, and those of other machines that were not written for a day."""
    foreign = []
    for place, machine, pid in _files(folder):
        if machine != host():
            foreign.append(place)
        elif not _is_alive(pid):
            with contextlib.suppress(OSError):  # network file systems may say that it is stale
                place.unlink(missing_ok=True)
    if not foreign:
        return
    with contextlib.suppress(OSError):  # a disk that cannot be written
        now = _time_of_disk(folder)
        for place in foreign:
            with contextlib.suppress(FileNotFoundError):  # its process has just finished
                if now - place.stat().st_mtime > ABANDONED:
                    place.unlink()


def _files(folder: Path) -> Iterator[tuple[Path, str, int]]:
    """The temporary files and markers, each with its machine and process."""
    for place in [*folder.glob("*.tmp"), *folder.glob("*/*.tmp")]:
        if owner := TEMPORARY.fullmatch(place.name):
            yield place, owner["host"], int(owner["pid"])
    for place in folder.glob("running/*.log"):
        machine, pid = ["", "", *place.name.split(".")][-3:-1]
        if machine and pid.isdigit():
            yield place, machine, int(pid)


def _time_of_disk(folder: Path) -> float:
    """The time (s) by the clock that dates the files: on a shared disk, that of the machine that has it."""
    with tempfile.NamedTemporaryFile(dir=folder) as file:
        file.write(b"now")
        file.flush()
        return os.fstat(file.fileno()).st_mtime


def _is_alive(pid: int) -> bool:
    """Whether a process of this machine runs. A zombie does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0] != "Z"
    except (OSError, IndexError):  # not Linux
        return True
