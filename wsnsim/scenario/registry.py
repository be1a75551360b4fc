"""Every kind of every role, found: in the table of `roles`, among what is installed, or by a dotted path.

Nothing heavy is imported here. A kind comes from the table, from an installed package (entry-point groups
`wsnsim.trackers`, `wsnsim.motions` ...: `Role.group`), or from a dotted path written as the kind itself
(`kind: mylab.trackers:Mine`). The table wins where names collide.

    load_class(find("tracker", "pso_mhpf")) -> the class
"""

from __future__ import annotations

import functools
import importlib
from typing import Any

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.scenario.kinds import ROLES, Role, Row

__all__ = ["ROLES", "Role", "Row", "find", "kinds", "load_class", "role_named"]


def role_named(word: str) -> Role:
    """The role of this name, singular or plural. Raises UsageError with the nearest one."""
    for role in ROLES.values():
        if word in (role.name, role.plural):
            return role
    raise UsageError(f"unknown role '{word}' ({did_you_mean(word, [role.plural for role in ROLES.values()])})")


def kinds(role: str) -> dict[str, Row]:
    """Every kind of a role by name, installed plug-ins included; importing none of them."""
    own = {row.kind: row for row in ROLES[role].rows}
    return own | {row.kind: row for row in _installed().get(ROLES[role].group, ()) if row.kind not in own}


def find(role: str, kind: str) -> Row:
    """The row of a kind, or of the class that a dotted path names. Raises LookupError with the nearest kind."""
    if ":" in kind:
        return Row(kind, kind, "")
    known = kinds(role)
    if kind not in known:
        raise LookupError(f"unknown {role} '{kind}' ({did_you_mean(kind, known)})")
    return known[kind]


def load_class(row: Row) -> type[Any]:
    """The class of a row. Raises ImportError with the import's own reason, in one line."""
    module, _, name = row.path.partition(":")
    named = row.path if row.kind == row.path else f"'{row.kind}' ({row.path})"
    try:
        found: Any = importlib.import_module(module)
        for step in name.split("."):
            found = getattr(found, step)
    except (Exception, SystemExit) as reason:  # whatever a plug-in's module may raise
        said = " ".join(str(reason).split())
        raise ImportError(f"{named} cannot be imported: {type(reason).__name__}: {said}") from reason
    if not isinstance(found, type):
        raise ImportError(f"{named} is no class")
    return found


@functools.cache
def _installed() -> dict[str, tuple[Row, ...]]:
    import importlib.metadata  # slow to import, and not needed to say what a command does

    groups: dict[str, tuple[Row, ...]] = {}
    for group in (role.group for role in ROLES.values()):
        points = sorted(importlib.metadata.entry_points(group=group), key=lambda point: point.name)
        if points:
            groups[group] = tuple(_row(point) for point in points)
    return groups


def _row(point: Any) -> Row:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "an installed package"
    return Row(point.name, point.value, f"plug-in of {package}", plugin=package)
