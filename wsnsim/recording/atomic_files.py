"""Files that get their name only when they are complete.

write_atomically(place, write)        write_text_atomically(place, text)        temporary_beside(place, name)
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

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
