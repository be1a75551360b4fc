"""Loading of scenarios: a source is read, values are assigned as with `--set`, then every key is checked.

    load('pso_mhpf', ['link.reach=80 m']) -> Scenario        load('pso_mhpf', {'link.reach': '80 m'}): the same

Heavy modules are imported where they are used: `wsnsim list` imports this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from wsnsim.base.errors import Issue, ScenarioError, UsageError, dotted, shown_value
from wsnsim.scenario.build import plain_json, resolved
from wsnsim.scenario.registry import Plugins
from wsnsim.scenario.texts import BROKEN, Assignment, Keys, LocatedValue, Origin

if TYPE_CHECKING:
    from wsnsim.scenario.schema import Scenario

OVERRIDES: Final = "a mapping such as {'link.reach': '60 m'}, or a list such as ['link.reach=60 m']"
"""What overrides may be, for messages."""

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
    from wsnsim.scenario.check import validated
    from wsnsim.scenario.reader import read_scenario
    from wsnsim.scenario.schema import Scenario

    if isinstance(source, Scenario):
        return source if not overrides else load(resolved(source), overrides)
    demand_scenario(source)
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


def demand_scenario(value: Any) -> None:
    """Refuse what is no scenario."""
    from wsnsim.scenario.schema import Scenario, shown_scenario

    if not isinstance(value, str | Path | Mapping | Scenario):
        message = "scenario: expected the name of a scenario, a file, a dict, or what wsnsim.load returned, got "
        raise UsageError(message + shown_scenario(value))


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


def assignments_of(overrides: Overrides, plugins: Plugins = Plugins.ANY) -> tuple[list[Assignment], list[Issue]]:
    """Return the assignments of texts such as 'a.b.c=value', or of pairs, and the issues of those that are wrong."""
    read = [_assignment(override, plugins) for override in listed(overrides)]
    assignments = [(keys, node) for keys, node, _ in read if node is not None and node.value is not BROKEN]
    return assignments, [issue for *_, issues in read for issue in issues]


def keys_of(written: str) -> Keys:
    """Return the path of keys that a text such as 'targets.0.bound' names, or () if it names none."""
    pieces = [piece.strip() for piece in written.split(".")]
    if not all(pieces):
        return ()
    return tuple(int(piece) if piece.isascii() and piece.isdigit() and len(piece) < 10 else piece for piece in pieces)


def _assignment(override: Override, plugins: Plugins) -> tuple[Keys, LocatedValue | None, list[Issue]]:
    from wsnsim.scenario.reader import read

    is_text = isinstance(override, str)
    written, sign, value = override.partition("=") if isinstance(override, str) else (override[0], "=", override[1])
    keys = keys_of(written) if isinstance(written, str) else ()
    if is_text and (not sign or not keys or not value.strip()):
        return (), None, [Issue((), "expected KEY=VALUE, such as link.reach='80 m'", f"--set {override!s}")]
    if not keys:
        return (), None, [Issue((), "expected keys, such as 'link.reach'", f"overrides {written!r}")]
    if keys[0] == "extends":
        return (), None, [Issue((), "'extends' is allowed in a file only", f"--set {written}" if is_text else written)]
    origin = Origin(f"--set {dotted(keys)}" if is_text else "", Path.cwd(), (), keys, plugins)
    if is_text:
        return keys, *read(value, origin)
    from wsnsim.scenario.python_values import of_dict

    return keys, *of_dict(value, origin, keys)


def _as_text(written: str, node: LocatedValue) -> str:
    """Return an assignment as the command line takes it: `tracker.particles=200`."""
    from wsnsim.scenario.reader import read

    value = plain_json(node.plain())
    if not isinstance(value, str):
        return f"{written}={json.dumps(value)}"
    again, _ = read(value, Origin("", Path()))
    return f"{written}={value if again is not None and again.value == value else json.dumps(value)}"


def text_like(source: str, name: str) -> str:
    """Return the text of a scenario that extends another one, whose values stand in comments.

    Args:
        source: The name or the file of the other one.
        name: The name of the new one.
    """
    import yaml

    values = {key: value for key, value in resolved(load(source)).items() if key != "name"}
    whole = (yaml.safe_dump({key: value}, default_flow_style=True, width=10**9, sort_keys=False).strip()
             for key, value in values.items())  # fmt: skip
    lines = [f"# {text[1:-1]}\n" for text in whole]  # without the braces of the mapping
    return (
        f"# As {source}, but for what you change: take the '#' from a line and change its values, in SI units.\n"
        f"{yaml.safe_dump({'extends': source, 'name': name}, sort_keys=False)}\n{''.join(lines)}"
    )
