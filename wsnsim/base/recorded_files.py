"""Which recorded files a scenario reads, and which of their rows are left out: for provenance and summaries.

recorded_files(setup) -> [ReadFile, ...]      provenance_of(setup) -> {} or the entries of a result's provenance
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import MOST_PRINTED
from wsnsim.base.ports import RecordedFile
from wsnsim.base.regular_files import file_digest
from wsnsim.base.setups import Setup

FILES: Final = "recorded_files"
COUNTS: Final = "skipped_rows"
ROWS: Final = "skipped"


@dataclass(frozen=True, slots=True)
class ReadFile:
    """A recorded file: its name without folder, the digest of its content, and the rows that are left out."""

    name: str
    digest: str
    skipped: tuple[str, ...]


def recorded_files(setup: Setup) -> list[ReadFile]:
    """The recorded files of a setup, each once: readings and trajectory may stand in the same one.

    Raises:
        RunError: a file cannot be read.
    """
    found: dict[tuple[str, str], dict[str, None]] = {}
    for component in _components(setup):
        key = Path(component.path).name, component.digest or file_digest(component.path)
        found.setdefault(key, {}).update(dict.fromkeys(component.skipped_rows(setup)))
    return [ReadFile(name, digest, tuple(skipped)) for (name, digest), skipped in found.items()]


def provenance_of(setup: Setup) -> dict[str, Any]:
    """The entries of a provenance: digests by file, counts of rows left out by file, and the first 50 of these rows."""
    files = recorded_files(setup)
    entries: dict[str, Any] = {FILES: {file.name: file.digest for file in files}} if files else {}
    if any(file.skipped for file in files):
        entries[COUNTS] = {file.name: len(file.skipped) for file in files if file.skipped}
        entries[ROWS] = [row for file in files for row in file.skipped][:MOST_PRINTED]
    return entries


def _components(setup: Setup) -> Iterator[RecordedFile]:
    """Yield the components that read a recorded file."""
    for value in vars(setup).values():
        for component in value if isinstance(value, tuple) else (value,):
            if isinstance(component, RecordedFile):
                yield component
