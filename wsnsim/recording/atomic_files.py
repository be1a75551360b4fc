"""Files that get their name only when they are complete.

write_atomically(place, write)        write_text_atomically(place, text)
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from wsnsim.recording.layout import cannot_write

TEMPORARY: Final = re.compile(r".*\.(?P<host>[^.]+)\.(?P<pid>\d+)(-\d+)?\.tmp")
"""Names of temporary files."""


def write_text_atomically(place: Path, text: str) -> None:
    """Write a text file as a whole or not at all. Raises StorageError."""
    write_atomically(place, lambda tmp: tmp.write_text(text, encoding="utf-8"))


def write_atomically(place: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary name, synchronise that file to the disk, and give it its name.

    Raises:
        StorageError: the file cannot be written. The temporary file is removed.
    """
    tmp = place.with_name(f"{place.name}.{host()}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        write(tmp)
        with tmp.open("rb+") as file:
            os.fsync(file.fileno())
        tmp.replace(place)
    except OSError as error:
        with contextlib.suppress(OSError):
            tmp.unlink(missing_ok=True)
        raise cannot_write(place, error) from error


def host() -> str:
    """The name of this machine, as it stands in names of files."""
    return re.sub(r"\W", "-", socket.gethostname().split(".")[0]) or "host"
