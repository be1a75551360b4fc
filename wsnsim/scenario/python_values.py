"""Values that a caller gives in Python, as a scenario would hold them.

    of_dict(mapping, origin) -> (LocatedValue, issues)
    values_of(PsoMhpf(particles=200), "tracker") -> {"kind": "pso_mhpf", "particles": 200, ...}
    values_of(Radio(...))                        -> {"bitrate": 250e3, ...}: a datasheet has no kind

A component becomes the mapping that YAML would hold, with every field, so that it replaces whatever it is merged with.
The kind of a plug-in's class is the name under which an installed package offers it, or its path, 'mylab:Mine'.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, Final

from wsnsim.base.errors import Issue
from wsnsim.scenario.fields import names_of, roles_of
from wsnsim.scenario.registry import AT_TOP, ROLES, kinds
from wsnsim.scenario.texts import BROKEN, DEEPEST, Entry, Keys, LocatedValue, Origin, Spot

_IN_A_FUNCTION: Final = "<locals>"


class WrongComponent(ValueError):
    """A value of a scenario is a Python object that cannot stand there. The message says what is wrong with it."""


def values_of(component: Any, role: str = "") -> dict[str, Any]:
    """Return the mapping of a component: its kind, if it plays a role, and the value of each of its fields.

    Args:
        component: an instance of a class with `@part`.
        role: the role that it plays; '' if it stands where no role is known.

    Raises:
        WrongComponent: it is a class, plays another role, or cannot be named in a scenario.
    """
    if isinstance(component, type):
        raise WrongComponent(f"is the class {component.__name__}, expected a component: {component.__name__}()")
    cls: Any = type(component)
    own, inner = _kind_of(cls, role), roles_of(cls)
    fields = {
        name: _within(getattr(component, name), inner[name].role if name in inner else "") for name in names_of(cls)
    }
    return ({"kind": own} if own else {}) | fields


def defaults_of(value: Any) -> dict[str, Any]:
    """Return the default values of a component's fields that have one; {} for anything else."""
    if not dataclasses.is_dataclass(value):
        return {}
    known = [(field.name, field.default) for field in dataclasses.fields(value)]
    return {name: default for name, default in known if default is not dataclasses.MISSING}


def role_at(path: tuple[str | int, ...]) -> str:
    """Return the role of the components at a path: of 'tracker', of an item of 'targets', of an axis of a sweep."""
    named = [key for key in path if isinstance(key, str)]
    return AT_TOP[named[-1]].name if named and named[-1] in AT_TOP else ""


def _within(value: Any, role: str) -> Any:
    if isinstance(value, tuple | list):
        return [_within(item, role) for item in value]
    return values_of(value, role) if dataclasses.is_dataclass(value) else value


def _kind_of(cls: type[Any], role: str) -> str:
    """Return the kind of a class; '' for a class that plays no role."""
    path = f"{cls.__module__}:{cls.__qualname__}"
    known = _known().get(path, {})
    if role in known or (known and not role):
        return known[role or next(iter(known))]
    if known:
        other = next(iter(known))
        raise WrongComponent(f"expected a {role}, got the {other} {cls.__name__}")
    if not role:
        return ""
    if _IN_A_FUNCTION in path:
        raise WrongComponent(f"the class {cls.__name__} is defined in a function: define it at the top of a module")
    return path


@functools.cache
def _known() -> Mapping[str, Mapping[str, str]]:
    """Return {path of a class: {role: kind}} of all kinds, those of installed packages included."""
    found: dict[str, dict[str, str]] = {}
    for role in ROLES:
        for info in kinds(role).values():
            found.setdefault(info.path, {})[role] = info.kind
    return found


def of_dict(
    values: Any, origin: Origin, path: Keys = (), inside: frozenset[int] = frozenset()
) -> tuple[LocatedValue, list[Issue]]:
    """Return the tree of a caller's dict.

    Tuples, ranges and arrays become lists, NumPy scalars their values, paths text, components mappings with their kind.
    """
    spot = Spot(origin)
    if len(path) > DEEPEST or id(values) in inside:
        return LocatedValue(BROKEN, spot), [
            spot.issue(path, f"nested deeper than {DEEPEST} levels, or contains itself")
        ]
    if hasattr(values, "tolist"):
        values = values.tolist()
    if dataclasses.is_dataclass(values):
        try:
            values = values_of(values, role_at(path))
        except WrongComponent as error:
            return LocatedValue(BROKEN, spot), [spot.issue(path, str(error))]
    if isinstance(values, Mapping | list | tuple | range):
        return _of_many(values, origin, path, inside | {id(values)})
    if hasattr(values, "__fspath__"):
        return LocatedValue(str(values), spot), []
    if values is None or isinstance(values, bool | int | float | str):
        return LocatedValue(values, spot), []
    return LocatedValue(BROKEN, spot), [spot.issue(path, f"a {type(values).__name__} is not allowed in a scenario")]


def _of_many(values: Any, origin: Origin, path: Keys, inside: frozenset[int]) -> tuple[LocatedValue, list[Issue]]:
    spot = Spot(origin)
    pairs = values.items() if isinstance(values, Mapping) else enumerate(values)
    inner = {}
    for name, value in pairs:
        key = str(name) if isinstance(values, Mapping) else name
        inner[key] = of_dict(value, origin, (*path, key), inside)
    issues = [issue for _, found in inner.values() for issue in found]
    if isinstance(values, Mapping):
        return LocatedValue({str(key): Entry(spot, node) for key, (node, _) in inner.items()}, spot), issues
    return LocatedValue([node for node, _ in inner.values()], spot), issues
