"""Whether the source text that a result holds gives the scenario that it holds.

compare(content, overrides, resolved) -> (what differs, what could not be compared)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from wsnsim.base.errors import ScenarioError
from wsnsim.base.leaves import differing_leaves
from wsnsim.scenario.build import resolved as resolved_of
from wsnsim.scenario.files import shipped
from wsnsim.scenario.load import ScenarioText, assignments_of, load, tree_of, validated
from wsnsim.scenario.located_values import LocatedValue, Origin, mapping, merged
from wsnsim.scenario.plugin_access import Plugins
from wsnsim.scenario.reader import of_dict, read

OF_THE_RUN = ("replicates",)
"""Keys that the command line may set without an override."""


def compare(
    content: str, overrides: Iterable[str], resolved: Mapping[str, Any], plugins: Plugins = Plugins.INSTALLED
) -> tuple[list[str], list[str]]:
    """What differs, as sentences, and what could not be compared.

    What a text takes from a file that does not come with wsnsim is not compared: such a file is never opened.

    Args:
        content: the text from which the scenario was read.
        overrides: the assignments with which it was read.
        resolved: all values of the scenario.
        plugins: which plug-ins all of these may name.
    """
    origin = Origin("", Path(), plugins=plugins)
    tree, issues = read(content, origin)
    if tree is None or issues or not isinstance(tree.value, dict):
        return ["its source text is not a scenario"], []
    base, own, unknown = _base_of(tree, resolved)
    assignments, wrong = assignments_of(overrides, plugins)
    text = ScenarioText(own if base is None else merged(base, own), wrong, ("", ""))
    try:
        known, found = load(resolved, plugins=plugins), validated(text, assignments)
    except ScenarioError as error:
        return [f"its source text is not a valid scenario: {error.issues[0].message}"], unknown
    differing = differing_leaves(resolved_of(known), resolved_of(found), OF_THE_RUN)
    said = [
        f"{key}: its source text says {after}, the stored scenario {before}"
        for key, (before, after) in differing.items()
    ]
    return said, unknown


def _base_of(tree: LocatedValue, resolved: Mapping[str, Any]) -> tuple[LocatedValue | None, LocatedValue, list[str]]:
    """What the text extends, its own values, and what is not known of the base.

    In place of a base that does not come with wsnsim stands the stored scenario: only the text's own values count.
    """
    entry = tree.value.get("extends")
    if entry is None:
        return None, tree, []
    own = mapping({key: value for key, value in tree.value.items() if key != "extends"}, tree.spot)
    root = next(iter(shipped().values())).parent
    name = str(entry.node.value)
    for folder in (root, root / "bases"):
        path = folder / name
        if path.suffix and path.is_file() and path.resolve().is_relative_to(root):
            return tree_of(path)[0], own, []
    note = f"what its source text takes from {name!r}, a file that does not come with wsnsim"
    return of_dict(dict(resolved), tree.spot.origin)[0], own, [note]
