"""A result's scenario as HTML: what each role is in words, what was changed, and the texts.

A result does not hold the scenario that its own extends. What was changed is said where that is one that comes with
wsnsim: no other file is opened, and no plug-in is imported.
"""

from __future__ import annotations

import html
import json
import os
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import WsnsimError
from wsnsim.recording import read_json, read_text
from wsnsim.scenario import load, resolved
from wsnsim.scenario.build import differing_leaves
from wsnsim.scenario.reader import read, read_scenario
from wsnsim.scenario.registry import AT_TOP, ROLES, Plugins, kinds
from wsnsim.scenario.texts import Origin, shipped

MAX_TEXT: Final = 60_000
"""Characters of a scenario's text that are shown (our choice)."""
MAX_ROW: Final = 400
"""Characters of a role in words, or of a change (our choice)."""
MAX_CHANGES: Final = 40
"""Changed values that are listed (our choice)."""
OF_EACH: Final = ("name", "replicates")
"""Keys that each scenario, or each run of it, has for itself."""


def isolated(text: object) -> str:
    """A text from a result as HTML, its writing direction isolated."""
    return f"<bdi>{html.escape(str(text))}</bdi>"


def scenario_html(path: Path) -> str:
    """The scenario in words, what was changed, as it was written, and with every default."""
    source, stored = (read_text(path, f"scenario/{name}", optional=True) for name in ("source_yaml", "resolved_json"))
    if not source and not stored:
        return "<p>The result does not contain its scenario.</p>"
    try:
        values = dict(json.loads(stored or "{}"))
    except (ValueError, TypeError):
        values = {}
    overridden = read_json(path, "provenance_json", optional=True).get("overrides", ())
    rows = "".join(f"<dt>{html.escape(head)}</dt><dd>{isolated(words)}</dd>" for head, words in in_words(values))
    changed = "".join(_changes_html(*each) for each in changes(source or "", values, bool(overridden)))
    whole = "\n".join(f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()) or stored
    texts = {"As it was written": source, "With every default, in SI units": whole}
    folded = (
        f"<details><summary>{head}</summary><pre>{html.escape(_shortened(text))}</pre></details>"
        for head, text in texts.items()
        if text
    )
    return f"<dl>{rows}</dl>{changed}{''.join(folded)}"


def in_words(scenario: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what each role of a resolved scenario is, with its numbers in SI units."""
    times = (f"{key} {_value(scenario[key])} s" for key in ("duration", "step") if key in scenario)
    yield "time", ", ".join([*times, f"seed {scenario.get('seed')}"])
    for key, role in AT_TOP.items():
        held = scenario.get(key)
        for component in (each for each in (held if isinstance(held, list) else [held]) if isinstance(each, dict)):
            kind = component.get("kind")
            if not isinstance(kind, str) or kind == role.default == "none":
                continue
            idea = known.idea if (known := kinds(role.name).get(kind)) else "a plug-in"
            values = (
                f"{name} {_value(value)}"
                for name, value in component.items()
                if name != "kind" and value not in (None, [], {}, "", False)
            )
            yield key, _shortened(f"{kind} ({idea}): {', '.join(values)}".removesuffix(": "), MAX_ROW)


def _shortened(text: str, most: int = MAX_TEXT) -> str:
    return text if len(text) <= most else f"{text[:most]}\n… ({len(text) - most:,} more characters)"


def changes(source: str, values: Mapping[str, Any], overridden: bool) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what a scenario changes in the one that it extends, and what its overrides change in the scenario.

    Args:
        source: its text.
        values: its values, with every default.
        overridden: whether there were overrides.

    Yields:
        (what it is changed against, {dotted key: (old value, new value)}); nothing where that is not known.
    """
    tree, issues = read(source, Origin("", Path(), plugins=Plugins.NONE))
    if tree is None or issues or not isinstance(tree.value, dict):
        return
    written, sides = tree.plain(), list[tuple[str, Mapping[str, Any]]]()
    try:
        if (extended := written.get("extends")) is not None:
            root = next(iter(shipped().values())).parent
            base = shipped().get(str(extended), root / str(extended))
            if not os.path.isfile(base) or not base.resolve().is_relative_to(root):  # noqa: PTH113 - any name is allowed
                return
            written["extends"] = str(base)
            sides.append((str(extended), resolved(load(_completed(base, values), plugins=Plugins.NONE))))
        if overridden:
            sides.append((str(values.get("name")), resolved(load(written, plugins=Plugins.NONE))))
    except WsnsimError:
        return
    for (name, old), (_, new) in pairwise([*sides, ("", values)]):
        if pairs := differing_leaves(old, new, OF_EACH):
            yield name, pairs


def _completed(base: Path, values: Mapping[str, Any]) -> dict[str, Any]:
    """The scenario of a file, with values of another one for the roles that it leaves to those that extend it."""
    tree = read_scenario(base, Plugins.NONE).tree
    given = tree.value if tree is not None else {}
    missing = [role for role in ROLES.values() if role.default is None and not any(key in given for key in role.keys)]
    own = {key: values[key] for role in missing for key in role.keys if key in values}
    return {"name": "base"} | own | {"extends": str(base)}


def _changes_html(name: str, pairs: Mapping[str, Any]) -> str:
    """A list of changed values. Of a component of another kind, only the kinds are named."""
    replaced = tuple(key.removesuffix("kind") for key in pairs if key.endswith(".kind"))
    shown = [key for key in pairs if key.endswith(".kind") or not key.startswith(replaced)]
    rows = [_shortened(f"{key}: {' → '.join(map(_value, pairs[key]))}", MAX_ROW) for key in shown[:MAX_CHANGES]]
    rows += [f"and {len(shown) - MAX_CHANGES} more"] if len(shown) > MAX_CHANGES else []
    items = "".join(f"<li>{isolated(row)}</li>" for row in rows)
    return f'<p>Changed against {isolated(name)}:</p><ul class="small">{items}</ul>'


def _value(value: Any) -> str:
    """A value of a scenario as text: of a component, or of a datasheet, its name."""
    if isinstance(value, dict):
        inner = (f"{key} {_value(each)}" for key, each in value.items())
        return str(value.get("name") or value.get("kind") or f"({', '.join(inner)})")
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
