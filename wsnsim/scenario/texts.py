"""Texts of scenarios, sweeps and datasheets: where files are found, their content, and the values in it with positions.

A name is looked up in a folder first (with or without '.yaml'), then among the files that come with wsnsim. Nothing
heavy is imported: `wsnsim list` uses this module.

    LocatedValue: a value (a scalar, a list of LocatedValues, or a dict of Entries) and its Spot
    Entry: the Spot of a key, and the LocatedValue under it

A tree of these is the common form of files, `--set` and dicts, and is what a scenario is until it is checked.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from wsnsim.base.errors import Issue, dotted
from wsnsim.base.files import read_regular, why_not_regular
from wsnsim.scenario.registry import AT_TOP, Plugins

DATA: Final = (".csv", ".gz", ".k7", ".xlsx", ".parquet", ".mat", ".gpx", ".geojson")
"""Endings of files that `wsnsim import` reads."""
FOLDER: Final = "is a folder, expected a scenario file, or that of a campaign in sweep, compare, watch and info"
LARGEST_FILE: Final = 10_000_000
SUFFIXES: Final = (".yaml", ".yml")
HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
SHEET: Final = re.compile(r"^sheet\s*:\s*(\w+)", re.MULTILINE)


def shipped() -> dict[str, Path]:
    """Return the scenarios that come with wsnsim, by name."""
    return {path.stem: path for path in _paths("*.yaml")}


def shipped_parts() -> dict[str, Path]:
    """Return the datasheets that come with wsnsim, by name."""
    return {path.stem: path for path in _paths("parts/*.yaml")}


def shipped_sweeps() -> dict[str, Path]:
    """Return the sweeps that come with wsnsim, by name."""
    return {path.stem: path for path in _paths("sweeps/*.yaml")}


def shipped_studies() -> dict[str, Path]:
    """Return the folders of the papers and studies that come with wsnsim, by name."""
    return {path.parent.name: path.parent for path in _paths("*/*/study.yaml")}


def template(name: str, offline: bool = False) -> str:
    """Return the text of a scenario of this name, with a network or without (`offline`)."""
    file = Path(__file__).with_name("templates") / ("offline.yaml" if offline else "tracking.yaml")
    return file.read_text(encoding="utf-8").replace("{name}", name)


def find_or_none(source: str | Path, folder: Path | None = None) -> Path | None:
    """Return the file of a scenario.

    Args:
        source: a path, with or without suffix, or the name of a shipped scenario.
        folder: where a relative path starts; None: the working directory.

    Returns:
        The file; the path itself if it is a folder; None if nothing has this name, or no file can have it.
    """
    start = Path(source) if folder is None else folder / source
    named = (start, *(start.with_name(start.name + suffix) for suffix in SUFFIXES if start.name))
    found = _first_file(named) or shipped().get(str(source).removesuffix(".yaml"))
    return found or (start if os.path.isdir(start) else None)  # noqa: PTH112 - a name that is too long is none


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


class TextFile(NamedTuple):
    """The file of a scenario: its path (None if nothing has the name), its text (None if unreadable), and issues."""

    path: Path | None
    content: str | None
    issues: list[Issue]


def text_file(source: str | Path, folder: Path | None = None) -> TextFile:
    """Return the file that `find_or_none` finds, with its text. `folder`: where a relative path starts, as there."""
    path = find_or_none(source, folder)
    return TextFile(None, None, []) if path is None else TextFile(path, *content_of(path))


def content_of(path: Path) -> tuple[str | None, list[Issue]]:
    """Return the text of a file, or None and an issue if it cannot be read as text."""
    if path.is_dir():
        return None, [Issue((), FOLDER, str(path))]
    if reason := why_not_regular(path):
        return None, [Issue((), reason, str(path))]
    if path.suffix.lower() in DATA:
        return None, [Issue((), "is a file of data, not a scenario; `wsnsim import` reads such files", str(path))]
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


def _paths(pattern: str) -> list[Path]:
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "_scenarios", package.parent / "scenarios"):
        if folder.is_dir():
            return sorted(folder.glob(pattern))
    return []


Key: TypeAlias = str | int
Keys: TypeAlias = tuple[Key, ...]
EXCERPT_WIDTH: Final = 110
DEEPEST: Final = 40
"""Levels of mappings and lists within each other. Our choice."""
BROKEN: Final = object()
"""Stands for a value whose issue is already reported, so that it is not reported again."""


class Origin(NamedTuple):
    """The origin of values: a file (name and lines), one `--set` (name and keys), or a caller's dict (no name).

    Relative paths in it start from `folder`. `plugins` says which plug-ins it may name.
    """

    name: str
    folder: Path
    lines: tuple[str, ...] = ()
    keys: Keys = ()
    plugins: Plugins = Plugins.ANY


class Spot(NamedTuple):
    """A position in a text (or another origin): line and column, both counted from 0."""

    origin: Origin
    line: int = 0
    column: int = 0

    def issue(self, path: Keys, message: str) -> Issue:
        """Return an issue at this position: 'x.yaml:3:5' with the line and a caret, '--set a.b', or the dict's keys."""
        if self.origin.lines:
            return Issue(path, message, f"{self.origin.name}:{self.line + 1}:{self.column + 1}", self._excerpt())
        if self.origin.name:
            return Issue(() if path == self.origin.keys else path, message, self.origin.name)
        return Issue((), message, dotted(path) or "scenario")

    def _excerpt(self) -> str:
        line = self.origin.lines[self.line] if self.line < len(self.origin.lines) else ""
        line = "".join(c if c.isprintable() else " " for c in line)
        if not line.strip():
            return ""
        start = max(0, self.column - EXCERPT_WIDTH // 2) if len(line) > EXCERPT_WIDTH else 0
        return f"    {line[start : start + EXCERPT_WIDTH].rstrip()}\n    {' ' * (self.column - start)}^"


@dataclass(frozen=True, slots=True)
class LocatedValue:
    """A value and its position. `size` is the number of values in it, where an alias counts at each use.

    Trees are immutable: `merged` and `assigned` return new ones that share the unchanged parts.
    """

    value: Any
    spot: Spot
    size: int = field(init=False, default=1)

    def __post_init__(self) -> None:
        if isinstance(self.value, dict | list):
            held = self.value if isinstance(self.value, list) else [entry.node for entry in self.value.values()]
            object.__setattr__(self, "size", 1 + sum(node.size for node in held))

    def plain(self) -> Any:
        """Return the values without their positions, as dicts, lists and scalars."""
        if isinstance(self.value, dict):
            return {key: entry.node.plain() for key, entry in self.value.items()}
        return [item.plain() for item in self.value] if isinstance(self.value, list) else self.value

    def child(self, key: Key) -> LocatedValue | None:
        """Return the value under a key or at an index, or None."""
        if isinstance(self.value, dict):
            entry: Entry | None = self.value.get(key)
            return entry.node if entry else None
        held = isinstance(self.value, list) and isinstance(key, int) and key < len(self.value)
        return self.value[key] if held else None

    def at(self, path: Keys) -> LocatedValue | None:
        """Return the value at a path, or None."""
        node: LocatedValue | None = self
        for key in path:
            node = node.child(key) if node is not None else None
        return node

    def spot_of(self, path: Keys, of_key: bool = False) -> Spot:
        """Return the position of the value at a path (or of its key), or of the nearest value around it."""
        node = self
        for depth, key in enumerate(path):
            inner = node.child(key)
            if inner is None:
                return node.spot
            if of_key and depth == len(path) - 1 and isinstance(node.value, dict):
                entry: Entry = node.value[key]
                return entry.spot
            node = inner
        return node.spot

    def merged(self, over: LocatedValue, path: Keys = ()) -> LocatedValue:
        """Return the tree with `over` merged into it.

        Mappings are merged key by key; all other values, and components whose kind changes, are replaced. A component
        without a kind takes that of `over`.
        """
        if not (isinstance(self.value, dict) and isinstance(over.value, dict)):
            return over
        new = over.child("kind")
        if path and new is not None and new.plain() != (self._kind(path) or new.plain()):
            return over
        kept = self.value if path else {key: entry for key, entry in self.value.items() if not over._replaces(key)}
        overlay = {
            key: Entry(entry.spot, kept[key].node.merged(entry.node, (*path, key))) if key in kept else entry
            for key, entry in over.value.items()
        }
        return LocatedValue(kept | overlay, over.spot)

    def _replaces(self, key: str) -> bool:
        """Return whether this tree gives the role of a key under its other key: `targets` instead of `motion`."""
        return key in AT_TOP and any(other in self.value for other in AT_TOP[key].keys if other != key)

    def assigned(self, path: Keys, new: LocatedValue, depth: int = 0) -> LocatedValue:
        """Return the tree with `new` at a path; missing mappings are created. A new kind drops the role's other keys.

        `check` puts back components that both kinds hold.

        Raises:
            LookupError: the path leads through a scalar, or to an item that the list does not have.
        """
        if depth == len(path):
            return new
        key, here = path[depth], dotted(path[:depth])
        if isinstance(self.value, list):
            if not (isinstance(key, int) and key < len(self.value)):
                raise LookupError(f"{here} has no item {key}: it is a list of {len(self.value)}, counted from 0")
            items = list(self.value)
            items[key] = items[key].assigned(path, new, depth + 1)
            return LocatedValue(items, self.spot)
        if not isinstance(self.value, dict):
            raise LookupError(f"{here} is a single value and has no '{key}'")
        if depth > 0 and path[depth:] == ("kind",) and new.plain() != self._kind(path[:depth]):
            return LocatedValue({"kind": Entry(new.spot, new)}, new.spot)
        old = self.value.get(str(key))
        inner = (old.node if old else LocatedValue({}, new.spot)).assigned(path, new, depth + 1)
        return LocatedValue({**self.value, str(key): Entry(old.spot if old else new.spot, inner)}, self.spot)

    def _kind(self, path: Keys) -> Any:
        """Return the kind of a role, written or by default."""
        written = self.child("kind")
        role = AT_TOP.get(str(path[0])) if len(path) == 1 else None
        return written.plain() if written else role.default if role else None


class Entry(NamedTuple):
    """The position of a key, and the value under it."""

    spot: Spot
    node: LocatedValue


Assignment: TypeAlias = tuple[Keys, LocatedValue]
"""A path of keys, and the value to put there."""


class ScenarioText(NamedTuple):
    """A scenario that is read but not checked: its tree (None if unreadable), issues, and (file name, content)."""

    tree: LocatedValue | None
    issues: list[Issue]
    origin: tuple[str, str] = ("", "")


def in_order(issues: Iterable[Issue]) -> list[Issue]:
    """Return the issues in the order of their positions in the text, each once."""

    def place(issue: Issue) -> tuple[str, int, int]:
        name, line, column = [*issue.place.rsplit(":", 2), "", ""][:3]
        return (name, int(line), int(column)) if line.isdigit() and column.isdigit() else (issue.place, 0, 0)

    return sorted(dict.fromkeys(issues), key=place)
