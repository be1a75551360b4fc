"""Values with their positions: the common form of scenario files, `--set` and dicts.

    LocatedValue: a value (a scalar, a list of LocatedValues, or a dict of Entries) and its Spot
    Entry: the Spot of a key, and the LocatedValue under it

Trees are immutable: `merged` and `assigned` return new ones that share the unchanged parts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

from wsnsim.base.errors import Issue
from wsnsim.scenario.plugin_access import Plugins
from wsnsim.scenario.registry import AT_TOP

Key: TypeAlias = str | int
Keys: TypeAlias = tuple[Key, ...]
EXCERPT_WIDTH: Final = 110
BROKEN: Final = object()
"""Stands for a value whose issue is already reported, so that it is not reported again."""


@dataclass(frozen=True)
class Origin:
    """The origin of values: a file (name and lines), one `--set` (name and keys), or a caller's dict (no name).

    Relative paths in it start from `folder`. `plugins` says which plug-ins it may name.
    """

    name: str
    folder: Path
    lines: tuple[str, ...] = ()
    keys: Keys = ()
    plugins: Plugins = Plugins.ANY


@dataclass(frozen=True, slots=True)
class Spot:
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
    """A value and its position; `size` is the number of values in it, where an alias counts at each use."""

    value: Any
    spot: Spot
    size: int = 1


@dataclass(frozen=True, slots=True)
class Entry:
    """The position of a key, and the value under it."""

    spot: Spot
    node: LocatedValue


def dotted(path: Keys) -> str:
    """Return a path as messages write it: targets.0.bound."""
    return ".".join(str(key) for key in path)


def mapping(entries: dict[str, Entry], spot: Spot) -> LocatedValue:
    """Return a mapping with these entries."""
    return LocatedValue(entries, spot, 1 + sum(entry.node.size for entry in entries.values()))


def sequence(items: list[LocatedValue], spot: Spot) -> LocatedValue:
    """Return a list with these items."""
    return LocatedValue(items, spot, 1 + sum(item.size for item in items))


def plain(node: LocatedValue) -> Any:
    """Return the values without their positions, as dicts, lists and scalars."""
    if isinstance(node.value, dict):
        return {key: plain(entry.node) for key, entry in node.value.items()}
    return [plain(item) for item in node.value] if isinstance(node.value, list) else node.value


def child(node: LocatedValue, key: Key) -> LocatedValue | None:
    """Return the value under a key or at an index, or None."""
    if isinstance(node.value, dict):
        entry = node.value.get(key)
        return entry.node if entry else None
    return node.value[key] if isinstance(node.value, list) and isinstance(key, int) and key < len(node.value) else None


def at(root: LocatedValue, path: Keys) -> LocatedValue | None:
    """Return the value at a path, or None."""
    node: LocatedValue | None = root
    for key in path:
        node = child(node, key) if node is not None else None
    return node


def spot_of(root: LocatedValue, path: Keys, of_key: bool = False) -> Spot:
    """Return the position of the value at a path (or of its key), or of the nearest value around it."""
    node = root
    for depth, key in enumerate(path):
        inner = child(node, key)
        if inner is None:
            return node.spot
        if of_key and depth == len(path) - 1 and isinstance(node.value, dict):
            entry: Entry = node.value[key]
            return entry.spot
        node = inner
    return node.spot


def merged(base: LocatedValue, over: LocatedValue, path: Keys = ()) -> LocatedValue:
    """Return `base` with `over` merged into it.

    Mappings are merged key by key; all other values, and components whose kind changes, are replaced.
    """
    if not (isinstance(base.value, dict) and isinstance(over.value, dict)):
        return over
    new = child(over, "kind")
    if path and new is not None and plain(new) != _kind(base, path):
        return over
    kept = base.value if path else {key: entry for key, entry in base.value.items() if not _is_replaced(key, over)}
    overlay = {
        key: Entry(entry.spot, merged(kept[key].node, entry.node, (*path, key))) if key in kept else entry
        for key, entry in over.value.items()
    }
    return mapping(kept | overlay, over.spot)


def _kind(node: LocatedValue, path: Keys) -> Any:
    """Return the kind of a role, written or by default."""
    written = child(node, "kind")
    role = AT_TOP.get(str(path[0])) if len(path) == 1 else None
    return plain(written) if written else role.default if role else None


def _is_replaced(key: str, over: LocatedValue) -> bool:
    """Return whether `over` gives the role under its other key, such as `targets` instead of `motion`."""
    return key in AT_TOP and any(other in over.value for other in AT_TOP[key].keys if other != key)


def assigned(node: LocatedValue, path: Keys, new: LocatedValue, depth: int = 0) -> LocatedValue:
    """Return the tree with `new` at a path; missing mappings are created. A new kind drops the role's other keys.

    Raises:
        LookupError: the path leads through a scalar, or to an item that the list does not have.
    """
    if depth == len(path):
        return new
    key, here = path[depth], dotted(path[:depth])
    if isinstance(node.value, list):
        if not (isinstance(key, int) and key < len(node.value)):
            raise LookupError(f"{here} has no item {key}: it is a list of {len(node.value)}, counted from 0")
        items = list(node.value)
        items[key] = assigned(items[key], path, new, depth + 1)
        return sequence(items, node.spot)
    if not isinstance(node.value, dict):
        raise LookupError(f"{here} is a single value and has no '{key}'")
    if depth > 0 and path[depth:] == ("kind",) and plain(new) != _kind(node, path[:depth]):
        return mapping({"kind": Entry(new.spot, new)}, new.spot)
    old = node.value.get(str(key))
    inner = assigned(old.node if old else LocatedValue({}, new.spot), path, new, depth + 1)
    return mapping({**node.value, str(key): Entry(old.spot if old else new.spot, inner)}, node.spot)


def in_order(issues: Iterable[Issue]) -> list[Issue]:
    """Return the issues in the order of their positions in the text, each once."""

    def place(issue: Issue) -> tuple[str, int, int]:
        name, line, column = [*issue.place.rsplit(":", 2), "", ""][:3]
        return (name, int(line), int(column)) if line.isdigit() and column.isdigit() else (issue.place, 0, 0)

    return sorted(dict.fromkeys(issues), key=place)
