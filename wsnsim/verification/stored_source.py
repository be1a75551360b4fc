"""Whether the source text that a result holds gives the scenario that it holds.

compare(content, overrides, resolved) -> (what differs, what could not be compared)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from wsnsim.base.errors import ScenarioError
from wsnsim.scenario.build import differing_leaves
from wsnsim.scenario.build import resolved as resolved_of
from wsnsim.scenario.check import is_path, validated
from wsnsim.scenario.load import assignments_of, load
from wsnsim.scenario.python_values import of_dict
from wsnsim.scenario.reader import read, read_scenario
from wsnsim.scenario.registry import Plugins
from wsnsim.scenario.texts import Entry, Keys, LocatedValue, Origin, ScenarioText, shipped

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
    base, own, unknown = _base_of(_with_stored_files(tree, resolved), resolved)
    written, wrong = assignments_of(overrides, plugins)
    assignments = [(keys, _with_stored_files(node, _at(resolved, keys), str(keys[-1]))) for keys, node in written]
    text = ScenarioText(own if base is None else base.merged(own), wrong, ("", ""))
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
    own = LocatedValue({key: value for key, value in tree.value.items() if key != "extends"}, tree.spot)
    root = next(iter(shipped().values())).parent
    name = str(entry.node.value)
    for folder in (root, root / "bases"):
        path = folder / name
        if path.suffix and path.is_file() and path.resolve().is_relative_to(root):
            return read_scenario(path).tree, own, []
    note = f"what its source text takes from {name!r}, a file that does not come with wsnsim"
    return of_dict(dict(resolved), tree.spot.origin)[0], own, [note]


def _with_stored_files(node: LocatedValue, stored: Any, key: str = "") -> LocatedValue:
    """The values with the stored file where a relative name ends it: the folder of the text is not known."""
    if isinstance(node.value, dict):
        held = stored if isinstance(stored, dict) else {}
        items = node.value.items()
        return LocatedValue(
            {name: Entry(one.spot, _with_stored_files(one.node, held.get(name), name)) for name, one in items},
            node.spot,
        )
    if isinstance(node.value, list):
        kept = stored if isinstance(stored, list) and len(stored) == len(node.value) else [None] * len(node.value)
        return LocatedValue(
            [_with_stored_files(one, held) for one, held in zip(node.value, kept, strict=True)], node.spot
        )
    if is_path(key) and isinstance(node.value, str) and isinstance(stored, str) and _ends(stored, node.value):
        return replace(node, value=stored)
    return node


def _ends(stored: str, written: str) -> bool:
    """Whether a stored path ends with a relative one, apart from steps to parent folders."""
    parts = [part for part in Path(written).parts if part not in (".", "..")]
    return bool(parts) and not Path(written).is_absolute() and list(Path(stored).parts[-len(parts) :]) == parts


def _at(stored: Any, keys: Keys) -> Any:
    """The stored value at a path of keys; None if there is none."""
    for key in keys:
        try:
            stored = stored[key]
        except (KeyError, IndexError, TypeError):
            return None
    return stored
