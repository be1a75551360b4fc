"""What killed processes left in a campaign's folder: temporary files, and markers of running tasks.

Whether a process of this machine lives can be asked. Of another machine's process only its files are known: they are
removed when they were not written for a day. If the process is alive after all, no result is lost or changed: a task
whose temporary file is gone is not stored, and is run again.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from wsnsim.recording.atomic_files import TEMPORARY, host

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
