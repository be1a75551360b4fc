"""A tree is checked against what scenarios may say.

    validate(tree) -> (Scenario or None, faults)

Which kinds a scenario chooses is settled first, and data sheets are put in place of their names; the model for just
these kinds then finds every other fault in one pass.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from pydantic import ValidationError

from wsnsim.base.errors import Issue
from wsnsim.scenario.datasheets import spelt_out
from wsnsim.scenario.fields import PartError, described, names_of
from wsnsim.scenario.kinds import AT_TOP, ROLES, Role, Scope
from wsnsim.scenario.located_values import (
    BROKEN,
    Entry,
    Keys,
    LocatedValue,
    at,
    child,
    mapping,
    plain,
    sequence,
    spot_of,
)
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.registry import kinds
from wsnsim.scenario.schema import Chosen, PartModel, Scenario, is_without_target, part_model, scenario_model

BEACON_STEP: Final = 1.0
"""s: between the rows of a network without a target, where the scenario says nothing else."""


def validate(tree: LocatedValue) -> tuple[Scenario | None, list[Issue]]:
    """The scenario that a tree says, or every fault of it."""
    if not isinstance(tree.value, dict):
        message = f"expected keys such as 'name', got {described(plain(tree))}"
        return None, [] if tree.value is BROKEN else [tree.spot.issue((), message)]
    sheet = child(tree, "sheet")
    if sheet is not None:
        said = f"is the data sheet of a {plain(sheet)}, and no scenario: name it in energy, as in radio: cc2420"
        return None, [tree.spot.issue((), said)]
    scope, issues = _scope(tree)
    tree = _with_defaults(tree, scope)
    chosen, wrong = _choose(tree, scope)
    tree, unknown = spelt_out(tree, chosen)
    issues += wrong + unknown
    model = scenario_model(chosen)
    data = _located(tree, chosen)
    for key in AT_TOP:
        if key not in dict(chosen):
            data.pop(key, None)
    try:
        scenario = model.model_validate(data)
    except ValidationError as error:
        return None, issues + issues_of(error, model, tree)
    scenario._tree = tree
    return (None if issues else scenario), issues


def with_sheets(tree: LocatedValue) -> LocatedValue:
    """The tree with the fields of data sheets in place of their names, as far as they are found."""
    chosen, _ = _choose(tree, Scope())
    spelt, issues = spelt_out(tree, chosen)
    return tree if issues else spelt


def _scope(tree: LocatedValue) -> tuple[Scope, list[Issue]]:
    """Which roles the scenario uses."""
    said, kind = at(tree, ("network",)), at(tree, ("workload", "kind"))
    network, targets = said is None or said.value != "none", kind is None or not _is_without_target(kind.value)
    if kind is None or network or targets:
        return Scope(network, targets), []
    message = "a network without a target needs a network: take 'network: none' out"
    return Scope(network=True, targets=False), [kind.spot.issue(("workload", "kind"), message)]


def _is_without_target(kind: Any) -> bool:
    try:
        return isinstance(kind, str) and is_without_target(part_model("workload", kind))
    except (LookupError, ImportError, PartError):
        return False


def _with_defaults(tree: LocatedValue, scope: Scope) -> LocatedValue:
    """The tree with an empty mapping for each role that is left out and has a default kind, or an empty list."""
    spot = tree.spot
    missing = {} if scope.targets else {"step": Entry(spot, LocatedValue(BEACON_STEP, spot))}
    for role in filter(scope.uses, ROLES.values()):
        if role.optional:
            missing[role.listed] = Entry(spot, sequence([], spot))
        elif default := scope.default(role):
            kind = {"kind": Entry(spot, LocatedValue(default, spot))} if default != role.default else {}
            missing[role.name] = Entry(spot, LocatedValue(kind, spot))
            given = child(tree, role.name)
            if kind and given is not None and isinstance(given.value, dict):
                tree = mapping(
                    tree.value | {role.name: Entry(given.spot, mapping(kind | given.value, given.spot))}, spot
                )
    return mapping(missing | tree.value, spot)


def _choose(tree: LocatedValue, scope: Scope) -> tuple[Chosen, list[Issue]]:
    """The models behind each key, by their kinds; a key of which no kind is known is left out."""
    chosen: dict[str, tuple[type[PartModel] | None, ...]] = {}
    issues: list[Issue] = []
    for key, path_and_node in _role_nodes(tree, scope, issues):
        found = tuple(_model_at(node, path, issues) for path, node in path_and_node)
        if any(found) or not found:
            chosen[key] = found
    return tuple(chosen.items()), issues


def _role_nodes(
    tree: LocatedValue, scope: Scope, issues: list[Issue]
) -> Iterator[tuple[str, list[tuple[Keys, LocatedValue]]]]:
    """(key, its mappings with their paths): one under a role's own name, several in a list."""
    for role in ROLES.values():
        alone = None if role.optional else child(tree, role.name)
        several = child(tree, role.listed) if role.listed else None
        if several is not None:
            if alone is not None:
                message = f"give either '{role.name}' or '{role.listed}', not both"
                issues.append(spot_of(tree, (role.listed,), of_key=True).issue((role.listed,), message))
            items = _items(several, role, issues)
            if items is not None:
                yield role.listed, items
        elif alone is not None:
            yield role.name, [((role.name,), alone)]
        elif scope.uses(role):
            also = f" (or '{role.listed}', a list of them)" if role.listed else ""
            issues.append(tree.spot.issue((role.name,), f"is missing: {role.purpose}{also}"))


def _items(several: LocatedValue, role: Role, issues: list[Issue]) -> list[tuple[Keys, LocatedValue]] | None:
    """The mappings of a list with their paths; None if it is none, or an empty one where there must be some."""
    if not isinstance(several.value, list) or not (several.value or role.optional):
        if several.value is not BROKEN:
            message = f"expected a list of {role.plural}, got {described(plain(several) or None)}"
            issues.append(several.spot.issue((role.listed,), message))
        return None
    return [((role.listed, i), node) for i, node in enumerate(several.value)]


def _model_at(node: LocatedValue, path: Keys, issues: list[Issue]) -> type[PartModel] | None:
    role = AT_TOP[str(path[0])]
    kind_path = (*path, "kind")
    written = child(node, "kind")
    if node.value is BROKEN or (written is not None and written.value is BROKEN):
        return None
    if not isinstance(node.value, dict):
        example = f"{{kind: {role.default or role.rows[0].kind}}}"
        issues.append(node.spot.issue(path, f"expected a mapping such as {example}, got {described(plain(node))}"))
        return None
    kind = plain(written) if written else role.default
    if not isinstance(kind, str):
        known = "known: " + ", ".join(kinds(role.name))
        problem = f"expected the name of a kind, got {described(kind)}" if written else f"is missing; {known}"
        issues.append((written or node).spot.issue(kind_path, problem))
        return None
    try:
        return part_model(role.name, kind)
    except (LookupError, ImportError, PartError) as error:
        issues.append((written or node).spot.issue(kind_path, str(error.args[0])))
        return None


def _located(tree: LocatedValue, chosen: Chosen) -> dict[str, Any]:
    """The plain values; file names (fields `path`, `..._path`) are taken from the folder of the text they stand in."""
    data: dict[str, Any] = plain(tree)
    for key, models in chosen:
        for i, model in enumerate(models):
            path: Keys = (key, i) if key == AT_TOP[key].listed else (key,)
            for field in (name for name in names_of(model.part) if _is_path(name)) if model else ():
                node = at(tree, (*path, field))
                if node is not None and isinstance(node.value, str) and node.value:
                    part = data[key][i] if len(path) > 1 else data[key]
                    part[field] = str((node.spot.text.folder / node.value).resolve())
    return data


def _is_path(field: str) -> bool:
    return field == "path" or field.endswith("_path")
