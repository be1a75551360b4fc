"""The files of scenarios, sweeps and datasheets: where they are found, and their text.

A name is looked up in a folder first (with or without '.yaml'), then among the files that come with wsnsim. Nothing
heavy is imported: `wsnsim list` uses this module.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from wsnsim.base.errors import Issue
from wsnsim.base.files import read_regular, why_not_regular

LARGEST_FILE: Final = 10_000_000
SUFFIXES: Final = (".yaml", ".yml")
HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
SHEET: Final = re.compile(r"^sheet\s*:\s*(\w+)", re.MULTILINE)


def shipped() -> dict[str, Path]:
    """Return the scenarios that come with wsnsim, by name."""
    return _shipped("*.yaml")


def shipped_parts() -> dict[str, Path]:
    """Return the datasheets that come with wsnsim, by name."""
    return _shipped("parts/*.yaml")


def shipped_sweeps() -> dict[str, Path]:
    """Return the sweeps that come with wsnsim, by name."""
    return _shipped("sweeps/*.yaml")


def shipped_studies() -> dict[str, Path]:
    """Return the folders of the papers and studies that come with wsnsim, by name."""
    return {path.parent.name: path.parent for path in _paths("*/*/study.yaml")}


def find(source: str | Path, folder: Path | None = None) -> Path | None:
    """Return the file of a scenario.

    Args:
        source: a path, with or without suffix, or the name of a shipped scenario.
        folder: where a relative path starts; None: the working directory.

    Returns:
        The file; the path itself if it is a folder; None if nothing has this name.
    """
    start = Path(source) if folder is None else folder / source
    for path in (start, *(start.with_name(start.name + suffix) for suffix in SUFFIXES if start.name)):
        if path.exists() and not path.is_dir():
            return path
    known = shipped().get(str(source).removesuffix(".yaml"))
    return known or (start if start.is_dir() else None)


def find_or_none(source: str | Path, folder: Path | None = None) -> Path | None:
    """Return what `find` returns, or None for a name that no file can have."""
    try:
        return find(source, folder)
    except (OSError, ValueError):
        return None


def is_result(source: str | Path) -> bool:
    """Return whether a file is a result (HDF5); one that cannot be read is by its name."""
    try:
        return read_regular(source, len(HDF5_SIGNATURE)) == HDF5_SIGNATURE
    except (OSError, ValueError):
        return str(source).endswith(".h5")


def find_sheet(name: str | Path, folder: Path) -> Path | None:
    """Return the datasheet of this name in a folder (with or without '.yaml'), else the shipped one, else None."""
    start = folder / name
    named = (start,) if start.suffix in SUFFIXES else tuple(Path(f"{start}{suffix}") for suffix in SUFFIXES)
    return _first_file(named) or shipped_parts().get(str(name).removesuffix(".yaml"))


def find_sweep(source: str | Path) -> Path | None:
    """Return the file of this name (with or without '.yaml'), else the shipped sweep, else None."""
    start = Path(source)
    named = (start, start.with_name(f"{start.name}.yaml") if start.name else start)
    return _first_file(named) or shipped_sweeps().get(str(source).removesuffix(".yaml"))


def content_of(path: Path) -> tuple[str | None, list[Issue]]:
    """Return the text of a file, or None and an issue if it cannot be read as text."""
    if path.is_dir():
        return None, [Issue((), "is a folder, expected a scenario file", str(path))]
    if reason := why_not_regular(path):
        return None, [Issue((), reason, str(path))]
    try:
        raw = read_regular(path, LARGEST_FILE + 1)
    except OSError as error:
        return None, [Issue((), f"cannot be read: {error.strerror}", str(path))]
    if len(raw) > LARGEST_FILE:
        return None, [Issue((), f"is too large for a scenario: the limit is {LARGEST_FILE // 1_000_000} MB", str(path))]
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        return None, [Issue((), "is a binary file (or not UTF-8), expected YAML text", str(path))]
    return text, []


def sheet_of(path: Path) -> str:
    """Return what a file is a datasheet of (its key `sheet`), or '' if it is no datasheet."""
    content, _ = content_of(path)
    match = SHEET.search(content or "")
    return match.group(1) if match else ""


def sheets(of: str) -> dict[str, Path]:
    """Return the shipped datasheets of a radio, of a processor and so on, by name."""
    return {name: path for name, path in shipped_parts().items() if sheet_of(path) == of}


def _first_file(paths: tuple[Path, ...]) -> Path | None:
    try:
        return next((path for path in paths if path.exists() and not path.is_dir()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None


def _shipped(pattern: str) -> dict[str, Path]:
    return {path.stem: path for path in _paths(pattern)}


def _paths(pattern: str) -> list[Path]:
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "_scenarios", package.parent / "scenarios"):
        if folder.is_dir():
            return sorted(folder.glob(pattern))
    return []
