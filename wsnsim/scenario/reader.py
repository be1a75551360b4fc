"""From a scenario's source to a tree of located values, with all issues of the text at once.

    read_scenario("pso_mhpf") -> ScenarioText       of a file or a caller's dict, merged with what it extends
    read(content, origin) -> (LocatedValue or None, issues)       of any YAML text

PyYAML composes the nodes; scalars follow the core schema of YAML 1.2: 1e3 is a float, 010 is ten, and 12:30:00, no and
on are text. Duplicate keys are issues; a merge key `<<` may repeat a key.
"""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean
from wsnsim.scenario.registry import Plugins
from wsnsim.scenario.texts import (
    BROKEN,
    DEEPEST,
    Entry,
    Keys,
    LocatedValue,
    Origin,
    ScenarioText,
    Spot,
    content_of,
    find_or_none,
    shipped,
)
from wsnsim.scenario.units import shown

MOST_EXTENDED: Final = 16
"""Files that may extend each other in a row. Our choice."""


def read_scenario(source: str | Path | Mapping[str, Any], plugins: Plugins = Plugins.ANY) -> ScenarioText:
    """Return the text of a scenario merged with what it extends, unchecked. `plugins`: which ones it may name."""
    if isinstance(source, Mapping):
        return _of_dict(source, plugins)
    path = find_or_none(source)
    if path is not None:
        return _of_file(path, plugins)
    message = f"file not found, and no shipped scenario has this name ({_nearest(source)})"
    return ScenarioText(None, [Spot(Origin(str(source), Path())).issue((), message)])


def _of_file(path: Path, plugins: Plugins, extending: tuple[Path, ...] = ()) -> ScenarioText:
    """Return the text of a file merged with the file it extends. `extending`: the files that led to this one."""
    content, issues = content_of(path)
    if content is None:
        return ScenarioText(None, issues)
    tree, issues = read(content, origin_of(path, content, plugins=plugins))
    return _extended(ScenarioText(tree, issues, (str(path), content)), path.parent, (*extending, path.resolve()))


def _of_dict(source: Mapping[str, Any], plugins: Plugins) -> ScenarioText:
    from wsnsim.scenario.python_values import of_dict

    tree, issues = of_dict(source, Origin("", Path.cwd(), plugins=plugins))
    if tree.value is BROKEN or issues:
        unresolved = isinstance(tree.value, dict) and "extends" in tree.value  # what it extends may give other keys
        return ScenarioText(None if unresolved else tree, issues)
    written = yaml.safe_dump(tree.plain(), sort_keys=False, allow_unicode=True)
    return _extended(ScenarioText(tree, issues, ("", written)), Path.cwd(), ())


def _extended(text: ScenarioText, folder: Path, extending: tuple[Path, ...]) -> ScenarioText:
    """Return a text of a folder merged with the files that its key `extends` names; later ones count."""
    tree = text.tree
    if tree is None or not isinstance(tree.value, dict) or "extends" not in tree.value:
        return text
    own = LocatedValue({key: entry for key, entry in tree.value.items() if key != "extends"}, tree.spot)
    entry = tree.value["extends"].node
    bases = list[ScenarioText]()
    for node in entry.value if isinstance(entry.value, list) and entry.value else [entry]:
        named = isinstance(node.value, str)
        path = find_or_none(node.value, folder) if named and node.value else None
        problem = ""
        if path is None:
            problem = f"there is no scenario {node.value!r}" if named else "expected the name of a scenario, or a list"
            problem += f" ({_nearest(str(node.value))})" * named
        elif path.resolve() in extending:
            problem = f"{path} extends itself"
        if path is None or problem:  # what the files lack without their base would follow from it
            return text._replace(tree=None, issues=[*text.issues, node.spot.issue(("extends",), problem)])
        if len(extending) > MOST_EXTENDED:
            raise ScenarioError([node.spot.issue(("extends",), f"more than {MOST_EXTENDED} files extend each other")])
        bases.append(_of_file(path, tree.spot.origin.plugins, extending))
    issues = [*text.issues, *(issue for base in bases for issue in base.issues)]
    trees = [base.tree for base in bases if base.tree is not None]
    unknown = issues and len(trees) < len(bases)
    return text._replace(tree=None if unknown else functools.reduce(LocatedValue.merged, [*trees, own]), issues=issues)


def _nearest(source: str | Path) -> str:
    path = Path(source)
    files = path.parent.glob("*.y*ml") if os.path.isdir(path.parent) else ()  # noqa: PTH112 - names that are too long
    known = did_you_mean(path.stem, shipped(), "`wsnsim list scenarios` shows all")
    return did_you_mean(path.name, [file.name for file in files], known)


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
    # a key without its colon is found at the next key only
    mark = error.context_mark if error.context == "while scanning a simple key" else error.problem_mark
    spot = Spot(origin, mark.line, mark.column) if mark else Spot(origin)
    details = ", ".join(piece for piece in (error.context, error.problem) if piece)
    details += " (are the keys of a mapping indented alike?)" * details.startswith("mapping values")
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
            return LocatedValue(self.entries(source, path), self.spot(source))
        return LocatedValue([self.node(item, (*path, i)) for i, item in enumerate(source.value)], self.spot(source))

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
