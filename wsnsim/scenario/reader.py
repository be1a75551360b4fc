"""From YAML text, or a caller's dict, to a tree of located values, with all issues of the text at once.

    read(content, origin) -> (LocatedValue or None, issues)    of_dict(mapping, origin) -> the same for a caller's dict
    values_of(PsoMhpf(particles=200), "tracker") -> {"kind": "pso_mhpf", "particles": 200, ...}
    values_of(Radio(...))                        -> {"bitrate": 250e3, ...}: a datasheet has no kind

PyYAML composes the nodes; scalars follow the core schema of YAML 1.2: 1e3 is a float, 010 is ten, and 12:30:00, no and
on are text. Duplicate keys are issues; a merge key `<<` may repeat a key.

A component that a caller made in Python becomes the mapping that YAML would hold, with every field, so that it replaces
whatever it is merged with. The kind of a plug-in's class is the name under which an installed package offers it, or its
path, 'mylab.trackers:Mine'.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from wsnsim.base.errors import Issue
from wsnsim.scenario.fields import names_of, roles_of
from wsnsim.scenario.located_values import BROKEN, Entry, Keys, LocatedValue, Origin, Spot, mapping, sequence
from wsnsim.scenario.plugin_access import Plugins
from wsnsim.scenario.registry import AT_TOP, ROLES, kinds
from wsnsim.scenario.units import shown

_IN_A_FUNCTION: Final = "<locals>"


class WrongComponent(ValueError):
    """A value of a scenario is a Python object that cannot stand there. The message says what is wrong with it."""


def is_component(value: Any) -> bool:
    """Return whether a value is a component, or the class of one."""
    return dataclasses.is_dataclass(value)


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
    own = _kind_of(type(component), role)
    inner = roles_of(type(component))
    fields = {
        name: _within(getattr(component, name), inner[name].role if name in inner else "")
        for name in names_of(type(component))
    }
    return ({"kind": own} if own else {}) | fields


def defaults_of(value: Any) -> dict[str, Any]:
    """Return the default values of a component's fields that have one; {} for anything else."""
    if not is_component(value):
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
    return values_of(value, role) if is_component(value) else value


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


DEEPEST: Final = 40
LARGEST: Final = 200_000
TAG: Final = "tag:yaml.org,2002:"
INT: Final = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
BOOL: Final = re.compile(r"true|True|TRUE|false|False|FALSE")
NULL: Final = re.compile(r"~|null|Null|NULL|")


class _CoreLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's loader with the resolvers of the core schema and a limit of its recursion. Our choice: 40 levels."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012
    levels = 0

    def descend_resolver(self, node: Any, index: Any) -> None:
        self.levels += 1
        if self.levels > DEEPEST:
            mark = node.start_mark if node is not None else None
            raise yaml.composer.ComposerError(None, None, f"nested deeper than {DEEPEST} levels", mark)

    def ascend_resolver(self) -> None:
        self.levels -= 1


for _tag, _pattern, _first in (
    ("bool", BOOL, list("tTfF")),
    ("int", INT, list("-+0123456789")),
    ("float", FLOAT, list("-+.0123456789")),
    ("null", NULL, ["~", "n", "N", ""]),
    ("merge", re.compile("<<"), ["<"]),
):
    _CoreLoader.add_implicit_resolver(TAG + _tag, re.compile(f"(?:{_pattern.pattern})$"), _first)


def origin_of(path: Path, content: str, keys: Keys = (), plugins: Plugins = Plugins.ANY) -> Origin:
    """Return the origin of values that are read from a file. `keys`: where they are put in the scenario."""
    return Origin(str(path), path.parent, tuple(content.splitlines()) or ("",), keys, plugins)


def read(content: str, origin: Origin) -> tuple[LocatedValue | None, list[Issue]]:
    """Return the tree of a YAML text (None if it is not YAML, or empty) and the issues of the text."""
    try:
        node = yaml.compose(content, Loader=_CoreLoader)
    except yaml.MarkedYAMLError as error:
        return None, [_syntax_issue(error, origin)]
    except yaml.reader.ReaderError as error:
        return None, [_character_issue(content, error, origin)]
    except UnicodeError:
        return None, [Spot(origin).issue((), "is not valid text: it contains half of a surrogate pair")]
    if node is None:
        return None, [Spot(origin).issue((), "is empty")]
    reading = _Reading(origin)
    return reading.node(node, ()), reading.issues


def _syntax_issue(error: yaml.MarkedYAMLError, origin: Origin) -> Issue:
    mark = error.problem_mark or error.context_mark
    spot = Spot(origin, mark.line, mark.column) if mark else Spot(origin)
    details = ", ".join(piece for piece in (error.context, error.problem) if piece)
    if "nesting depth" in details:  # libyaml has a limit of its own, which may be the first that is met
        details = f"nested deeper than {DEEPEST} levels"
    return spot.issue(origin.keys, f"not valid YAML: {details}")


def _character_issue(content: str, error: yaml.reader.ReaderError, origin: Origin) -> Issue:
    before = content[: error.position]
    spot = Spot(origin, before.count("\n"), len(before) - before.rfind("\n") - 1)
    code = error.character if isinstance(error.character, int) else ord(error.character)
    return spot.issue(origin.keys, f"not valid YAML: the character U+{code:04X} is not allowed")


@dataclass
class _Reading:
    """The state of reading one text: its issues, the finished nodes, and the open ones (an alias to one is endless)."""

    origin: Origin
    issues: list[Issue] = field(default_factory=list)
    known: dict[int, LocatedValue] = field(default_factory=dict)
    open: set[int] = field(default_factory=set)

    def node(self, source: yaml.Node, path: Keys) -> LocatedValue:
        if id(source) in self.known:
            return self.known[id(source)]
        if id(source) in self.open:
            return self.complain(source, path, "an anchor cannot contain itself")
        self.open.add(id(source))
        node = self.fresh(source, path)
        self.open.discard(id(source))
        if node.size > LARGEST:
            node = self.complain(source, path, f"contains more than {LARGEST} values when its aliases are expanded")
        self.known[id(source)] = node
        return node

    def fresh(self, source: yaml.Node, path: Keys) -> LocatedValue:
        if isinstance(source, yaml.ScalarNode):
            return self.scalar(source, path)
        if source.tag not in (TAG + "map", TAG + "seq"):
            return self.complain(source, path, f"unknown tag {shown(source.tag.removeprefix(TAG))}")
        if isinstance(source, yaml.MappingNode):
            return mapping(self.entries(source, path), self.spot(source))
        return sequence([self.node(item, (*path, i)) for i, item in enumerate(source.value)], self.spot(source))

    def entries(self, source: yaml.MappingNode, path: Keys) -> dict[str, Entry]:
        """Return the entries of a mapping: those of its merge keys, replaced by its own."""
        own: dict[str, Entry] = {}
        merged: dict[str, Entry] = {}
        for key, value in source.value:
            if not isinstance(key, yaml.ScalarNode):
                self.complain(key, path, "a key must be a scalar")
            elif key.tag == TAG + "merge":
                merged = self.of_merge_key(value, path) | merged
            elif key.value in own:
                first = own[key.value].spot.line + 1
                self.complain(key, path, f"duplicate key {shown(key.value)} (first at line {first})")
            else:
                own[key.value] = Entry(self.spot(key), self.node(value, (*path, key.value)))
        return merged | own

    def of_merge_key(self, source: yaml.Node, path: Keys) -> dict[str, Entry]:
        """Return the entries of a merge key; of several mappings, the earlier wins."""
        found: dict[str, Entry] = {}
        for item in source.value if isinstance(source, yaml.SequenceNode) else [source]:
            node = self.node(item, path)
            if isinstance(node.value, dict):
                found = node.value | found
            else:
                self.complain(item, path, "'<<' merges mappings only")
        return found

    def scalar(self, source: yaml.ScalarNode, path: Keys) -> LocatedValue:
        tag = source.tag.removeprefix(TAG)
        if tag not in ("str", "int", "float", "bool", "null", "merge", "!"):
            return self.complain(source, path, f"unknown tag {shown(tag)}")
        try:
            return LocatedValue(_value(tag, source.value), self.spot(source))
        except ValueError as error:
            return self.complain(source, path, str(error))

    def spot(self, source: yaml.Node) -> Spot:
        return Spot(self.origin, source.start_mark.line, source.start_mark.column)

    def complain(self, source: yaml.Node, path: Keys, message: str) -> LocatedValue:
        self.issues.append(self.spot(source).issue((*self.origin.keys, *path), message))
        return LocatedValue(BROKEN, self.spot(source))


def _value(tag: str, text: str) -> Any:
    """Return the value of a scalar. Raises ValueError if the text does not fit its tag or the number is too large."""
    rule = {"int": INT, "float": FLOAT, "bool": BOOL, "null": NULL}.get(tag)
    if rule is None:
        return text
    if not rule.fullmatch(text) and not (tag == "float" and INT.fullmatch(text)):
        raise ValueError(f"{shown(text)} is not a valid {tag}")
    if tag == "null":
        return None
    if tag == "bool":
        return text.lower() == "true"
    return _integer(text) if tag == "int" else _real(text)


def _integer(text: str) -> int:
    if len(text) > 400:
        raise ValueError(f"{shown(text)} is too large for a number")
    return int(text[2:], 8 if text[1] == "o" else 16) if text[:2] in ("0o", "0x") else int(text)


def _real(text: str) -> float:
    if text.lower().endswith(("inf", "nan")):
        return float(text.replace(".", "", 1))
    value = float(text if not text.startswith(("0x", "0o")) else _integer(text))
    if math.isinf(value):
        raise ValueError(f"{shown(text)} is too large for a number")
    return value


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
    if is_component(values):
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
        return mapping({str(key): Entry(spot, node) for key, (node, _) in inner.items()}, spot), issues
    return sequence([node for node, _ in inner.values()], spot), issues
