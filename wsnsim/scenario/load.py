"""Loading of scenarios: a text is merged with the file it extends and with `--set`, then every key is checked.

    load('pso_mhpf', ['link.reach=80 m']) -> Scenario        load('pso_mhpf', {'link.reach': '80 m'}): the same

Heavy modules are imported where they are used: `wsnsim list` imports this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from wsnsim.base.errors import Issue, ScenarioError, UsageError, did_you_mean, shown_value
from wsnsim.scenario.build import demand_scenario, plain_json, resolved
from wsnsim.scenario.files import content_of, find_or_none, shipped
from wsnsim.scenario.plugin_access import Plugins

if TYPE_CHECKING:
    from wsnsim.scenario.located_values import LocatedValue
    from wsnsim.scenario.schema import Scenario

MOST_EXTENDED: Final = 16
"""Files that may extend each other in a row. Our choice."""

OVERRIDES: Final = "a mapping such as {'link.reach': '60 m'}, or a list such as ['link.reach=60 m']"
"""What overrides may be, for messages."""

Keys: TypeAlias = tuple[str | int, ...]
Assignment: TypeAlias = "tuple[Keys, LocatedValue]"
"""A path of keys, and the value to put there."""
Override: TypeAlias = str | tuple[str, Any]
"""A value that replaces one of the scenario: 'link.reach=80 m', or ('link.reach', '80 m')."""
Overrides: TypeAlias = Iterable[Override] | Mapping[str, Any]
"""Values that replace those of the scenario, as a list or as a mapping; in Python a value may be a component."""


def load(
    source: str | Path | Mapping[str, Any] | Scenario, overrides: Overrides = (), plugins: Plugins = Plugins.ANY
) -> Scenario:
    """Return the checked scenario of a file, of a shipped scenario's name or of a dict.

    Args:
        source: what to load. A Scenario is returned as it is, unless there are overrides.
        overrides: assignments that replace values, such as 'link.reach=80 m', or {'link.reach': '80 m'}.
        plugins: which plug-ins the source, and what it extends, may name. Overrides may name any.

    Raises:
        ScenarioError: with every issue found, each at its place in the text.
        UsageError: the source is no scenario, or the overrides have another form.
    """
    from wsnsim.scenario.schema import Scenario

    demand_scenario(source)
    if isinstance(source, Scenario):
        return source if not overrides else load(resolved(source), overrides)
    text = read_scenario(source, plugins)
    if text.tree is None:
        raise ScenarioError(text.issues)
    written = listed(overrides)
    assignments, issues = assignments_of(written)
    scenario = validated(text, assignments, issues)
    scenario._overrides = tuple(
        each if isinstance(each, str) else _as_text(each[0], node)
        for each, (_, node) in zip(written, assignments, strict=True)
    )
    return scenario


def listed(overrides: Overrides) -> tuple[Override, ...]:
    """Return overrides as a tuple, whichever form they have.

    Raises:
        UsageError: they have another form.
    """
    if isinstance(overrides, Mapping):
        return tuple(overrides.items())
    if isinstance(overrides, str):
        return (overrides,)
    if not isinstance(overrides, Iterable) or isinstance(overrides, bytes):
        raise UsageError(f"overrides: expected {OVERRIDES}, got {shown_value(overrides)}")
    found = tuple(overrides)
    for each in found:
        pair = isinstance(each, tuple) and len(each) == 2
        if not isinstance(each, str) and not pair:
            raise UsageError(f"overrides: expected {OVERRIDES}, got {shown_value(each)} in it")
    return found


class ScenarioText(NamedTuple):
    """A scenario that is read but not checked: its tree (None if unreadable), issues, and (file name, content)."""

    tree: LocatedValue | None
    issues: list[Issue]
    origin: tuple[str, str]


def read_scenario(source: str | Path | Mapping[str, Any], plugins: Plugins = Plugins.ANY) -> ScenarioText:
    """Return the text of a scenario merged with what it extends, unchecked. `plugins`: which ones it may name."""
    read = _from_dict(source, plugins) if isinstance(source, Mapping) else _from_file(source, plugins)
    return ScenarioText(*read)


def validated(text: ScenarioText, assignments: Iterable[Assignment], issues: Iterable[Issue] = ()) -> Scenario:
    """Return the checked scenario of a text with values assigned. One text may give many scenarios.

    Args:
        text: what `read_scenario` returned; its tree is not None.
        assignments: the values to assign.
        issues: what was wrong before, to be reported together.

    Raises:
        ScenarioError: with every issue found.
    """
    from wsnsim.scenario.check import validate
    from wsnsim.scenario.located_values import in_order

    assert text.tree is not None
    tree, of_assignments = _assigned(text.tree, assignments)
    scenario, of_scenario = validate(tree)
    found = [*text.issues, *issues, *of_assignments, *of_scenario]
    if scenario is None or found:
        raise ScenarioError(in_order(found))
    scenario._source = text.origin
    return scenario


def assignments_of(overrides: Overrides, plugins: Plugins = Plugins.ANY) -> tuple[list[Assignment], list[Issue]]:
    """Return the assignments of texts such as 'a.b.c=value', or of pairs, and the issues of those that are wrong."""
    read = [
        _assignment(override, plugins) if isinstance(override, str) else _of_pair(*override, plugins)
        for override in listed(overrides)
    ]
    assignments = [(keys, node) for keys, node, _ in read if node is not None]
    return assignments, [issue for *_, issues in read for issue in issues]


def tree_of(path: Path) -> tuple[LocatedValue | None, list[Issue]]:
    """Return the values of a scenario's file merged with what it extends, unchecked; None if it cannot be read."""
    content, issues = content_of(path)
    return (None, issues) if content is None else _tree_of(path, content, (), Plugins.ANY)


def keys_of(written: str) -> Keys:
    """Return the path of keys that a text such as 'targets.0.bound' names, or () if it names none."""
    pieces = [piece.strip() for piece in written.split(".")]
    if not all(pieces):
        return ()
    return tuple(int(piece) if piece.isascii() and piece.isdigit() and len(piece) < 10 else piece for piece in pieces)


def _from_file(source: str | Path, plugins: Plugins) -> tuple[LocatedValue | None, list[Issue], tuple[str, str]]:
    from wsnsim.scenario.located_values import Origin, Spot

    path = find_or_none(source)
    if path is None:
        message = f"file not found, and no shipped scenario has this name ({_nearest(source)})"
        return None, [Spot(Origin(str(source), Path())).issue((), message)], ("", "")
    content, issues = content_of(path)
    if content is None:
        return None, issues, ("", "")
    tree, issues = _tree_of(path, content, (), plugins)
    return tree, issues, (str(path), content)


def _from_dict(source: Mapping[str, Any], plugins: Plugins) -> tuple[LocatedValue | None, list[Issue], tuple[str, str]]:
    import yaml

    from wsnsim.scenario.located_values import BROKEN, Origin, plain
    from wsnsim.scenario.reader import of_dict

    tree, issues = of_dict(source, Origin("", Path.cwd(), plugins=plugins))
    if tree.value is BROKEN or issues:
        unresolved = isinstance(tree.value, dict) and "extends" in tree.value  # what it extends may give other keys
        return None if unresolved else tree, issues, ("", "")
    written = yaml.safe_dump(plain(tree), sort_keys=False, allow_unicode=True)
    if "extends" not in tree.value:
        return tree, issues, ("", written)
    return *_extended(tree, issues, Path.cwd(), ()), ("", written)


def _tree_of(
    path: Path, content: str, extending: tuple[Path, ...], plugins: Plugins
) -> tuple[LocatedValue | None, list[Issue]]:
    """Return the tree of a file merged with the file it extends. `extending`: the files that led to this one."""
    from wsnsim.scenario.reader import origin_of, read

    tree, issues = read(content, origin_of(path, content, plugins=plugins))
    if tree is None or not isinstance(tree.value, dict) or "extends" not in tree.value:
        return tree, issues
    return _extended(tree, issues, path.parent, (*extending, path.resolve()))


def _extended(
    tree: LocatedValue, issues: list[Issue], folder: Path, extending: tuple[Path, ...]
) -> tuple[LocatedValue | None, list[Issue]]:
    from wsnsim.scenario.located_values import mapping, merged

    own = mapping({key: entry for key, entry in tree.value.items() if key != "extends"}, tree.spot)
    node = tree.value["extends"].node
    path = find_or_none(node.value, folder) if isinstance(node.value, str) and node.value else None
    if path is None:
        problem = (
            f"there is no scenario {node.value!r}" if isinstance(node.value, str) else "expected the name of a scenario"
        )
        return own, [*issues, node.spot.issue(("extends",), f"{problem} ({_nearest(str(node.value))})")]
    if path.resolve() in extending:
        return own, [*issues, node.spot.issue(("extends",), f"{path} extends itself")]
    if len(extending) > MOST_EXTENDED:
        raise ScenarioError([node.spot.issue(("extends",), f"more than {MOST_EXTENDED} files extend each other")])
    content, unreadable = content_of(path)
    plugins = tree.spot.origin.plugins
    base, found = (None, unreadable) if content is None else _tree_of(path, content, extending, plugins)
    return (own if base is None else merged(base, own)), [*issues, *found]


def _nearest(source: str | Path) -> str:
    return did_you_mean(Path(source).stem, shipped())


def _assigned(tree: LocatedValue, assignments: Iterable[Assignment]) -> tuple[LocatedValue, list[Issue]]:
    """Return the tree with the values assigned: whole roles and kinds first, because they replace the role."""
    from wsnsim.scenario.check import with_sheets
    from wsnsim.scenario.located_values import assigned

    issues: list[Issue] = []
    for keys, node in sorted(assignments, key=lambda pair: len(pair[0]) > 1 and pair[0][-1] != "kind"):
        if not isinstance(tree.value, dict):
            continue
        if len(keys) > 2:  # the path may lead into a datasheet
            tree = with_sheets(tree)
        try:
            tree = assigned(tree, keys, node)
        except LookupError as error:
            issues.append(node.spot.issue(keys, str(error.args[0])))
    return tree, issues


def _assignment(override: str, plugins: Plugins) -> tuple[Keys, LocatedValue | None, list[Issue]]:
    from wsnsim.scenario.located_values import Origin, dotted
    from wsnsim.scenario.reader import read

    written, sign, value = override.partition("=")
    keys = keys_of(written)
    if not sign or not keys or not value.strip():
        return (), None, [Issue((), "expected KEY=VALUE, such as link.reach='80 m'", f"--set {override}")]
    if keys[0] == "extends":
        return (), None, [Issue((), "'extends' is allowed in a file only", f"--set {written}")]
    node, issues = read(value, Origin(f"--set {dotted(keys)}", Path.cwd(), (), keys, plugins))
    return keys, node, issues


def _of_pair(written: str, value: Any, plugins: Plugins) -> tuple[Keys, LocatedValue | None, list[Issue]]:
    """Return the assignment of a value that a caller gives in Python."""
    from wsnsim.scenario.located_values import BROKEN, Origin
    from wsnsim.scenario.reader import of_dict

    keys = keys_of(written) if isinstance(written, str) else ()
    if not keys:
        return (), None, [Issue((), "expected keys, such as 'link.reach'", f"overrides {written!r}")]
    if keys[0] == "extends":
        return (), None, [Issue((), "'extends' is allowed in a file only", written)]
    node, issues = of_dict(value, Origin("", Path.cwd(), (), keys, plugins), keys)
    return keys, None if node.value is BROKEN else node, issues


def _as_text(written: str, node: LocatedValue) -> str:
    """Return an assignment as the command line takes it: `tracker.particles=200`."""
    from wsnsim.scenario.located_values import Origin, plain
    from wsnsim.scenario.reader import read

    value = plain_json(plain(node))
    if not isinstance(value, str):
        return f"{written}={json.dumps(value)}"
    again, _ = read(value, Origin("", Path()))
    return f"{written}={value if again is not None and again.value == value else json.dumps(value)}"
