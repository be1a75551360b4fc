"""Validation of a scenario's tree.

    validated(text, assignments) -> Scenario

First the kinds of all roles are determined, and datasheets replace their names. The pydantic model of exactly these
kinds then finds all other issues in one pass.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, cast, get_args

from pydantic import Field, ValidationError, create_model

from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.base.files import file_digest
from wsnsim.scenario.datasheets import with_fields
from wsnsim.scenario.fields import Inner, PartError, PartModel, names_of, nested_of, part_model, roles_of
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.registry import AT_TOP, ROLES, Role, Scope, demand_class, kinds
from wsnsim.scenario.schema import Chosen, Scenario, is_without_target, scenario_model, with_radio
from wsnsim.scenario.texts import BROKEN, Assignment, Entry, Keys, LocatedValue, ScenarioText, Spot, in_order
from wsnsim.scenario.units import described

InnerKinds = type[PartModel] | None | tuple[type[PartModel] | None, ...]
"""The model of the component that a field holds, or those of a list; None for one whose kind has an issue."""


@functools.cache
def with_inner(model: type[PartModel], inner: tuple[tuple[str, InnerKinds], ...]) -> type[PartModel]:
    """Return the model of a kind whose fields hold components of these kinds."""
    fields: dict[str, Any] = {
        name: (
            _annotation_of_kinds(chosen),
            Field(model.model_fields[name].default, description=model.model_fields[name].description),
        )
        for name, chosen in inner
        if chosen != ()  # an empty list is of the same model as none
    }
    return create_model(model.__name__, __base__=model, __module__=model.__module__, **fields) if fields else model


def _annotation_of_kinds(chosen: InnerKinds) -> Any:
    if isinstance(chosen, tuple):
        return tuple[tuple(kind or Any for kind in chosen)]  # type: ignore[misc]
    return chosen or Any


def inner_models(model: type[PartModel]) -> dict[Keys, type[PartModel]]:
    """Return the models of the components that a component holds, by their paths in it, where the kinds are known."""
    found: dict[Keys, Any] = {}
    for name, inner in roles_of(model.part).items():
        held = model.model_fields[name].annotation
        if inner.several:
            found.update(((name, i), kind) for i, kind in enumerate(get_args(held)))
        else:
            found[name,] = held
    return {path: kind for path, kind in found.items() if isinstance(kind, type) and issubclass(kind, PartModel)}


BEACON_STEP: Final = 1.0
"""Time (s) between result rows of a network without a target, unless the scenario gives `step`."""


def validated(text: ScenarioText, assignments: Iterable[Assignment], issues: Iterable[Issue] = ()) -> Scenario:
    """Return the checked scenario of a text with values assigned. One text may give many scenarios.

    Args:
        text: what `load.read_scenario` returned; its tree is not None.
        assignments: the values to assign.
        issues: what was wrong before, to be reported together.

    Raises:
        ScenarioError: with every issue found.
    """
    assert text.tree is not None
    tree, of_assignments = _assigned(text.tree, assignments)
    scenario, of_scenario = validate(tree)
    found = [*text.issues, *issues, *of_assignments, *of_scenario]
    if scenario is None or found:
        raise ScenarioError(in_order(found))
    scenario._source = text.origin
    return scenario


def _assigned(tree: LocatedValue, assignments: Iterable[Assignment]) -> tuple[LocatedValue, list[Issue]]:
    """Return the tree with the values assigned: whole roles and kinds first, because they replace the role."""
    issues: list[Issue] = []
    for keys, node in sorted(assignments, key=lambda pair: len(pair[0]) > 1 and pair[0][-1] != "kind"):
        if not isinstance(tree.value, dict):
            continue
        if len(keys) > 2:  # the path may lead into a datasheet
            tree = _with_sheets(tree)
        try:
            tree = _with_held(tree.assigned(keys, node), tree, keys)
        except LookupError as error:
            issues.append(node.spot.issue(keys, str(error.args[0])))
    return tree, issues


def _with_held(tree: LocatedValue, before: LocatedValue, keys: Keys) -> LocatedValue:
    """Return the tree after a new kind, with the components that the old kind held where the new one holds such, too.

    So another tracker of several targets keeps filter and management. Other keys are those of the old kind alone.
    """
    role, old, new = AT_TOP.get(str(keys[0])), before.at(keys[:-1]), tree.at(keys[:-1])
    if role is None or keys[-1] != "kind" or old is None or new is None:
        return tree
    former, later = (_roles_at(role, node) for node in (old, new))
    held = [name for name, inner in later.items() if former.get(name) == inner and name in old.value]
    return tree.assigned(keys[:-1], LocatedValue(new.value | {name: old.value[name] for name in held}, new.spot))


def _roles_at(role: Role, node: LocatedValue) -> Mapping[str, Inner]:
    """Return the roles of the components that a component holds; none if its kind is unknown."""
    kind = node.child("kind")
    try:
        return roles_of(_model_of(role.name, str(kind.value), kind.spot).part) if kind else {}
    except (LookupError, ImportError, PartError):  # reported where it stands
        return {}


def _with_sheets(tree: LocatedValue) -> LocatedValue:
    """Return the tree with the fields of datasheets in place of their names, or as it is if one has issues."""
    chosen, _ = _choose(tree, Scope())
    complete, issues = with_fields(tree, chosen)
    return tree if issues else complete


def validate(tree: LocatedValue) -> tuple[Scenario | None, list[Issue]]:
    """Return the scenario of a tree, or None and all its issues."""
    if not isinstance(tree.value, dict):
        message = f"expected keys such as 'name', got {described(tree.plain())}"
        return None, [] if tree.value is BROKEN else [tree.spot.issue((), message)]
    sheet = tree.child("sheet")
    if sheet is not None:
        message = f"is the datasheet of a {sheet.plain()}, not a scenario: name it in energy, as in radio: cc2420"
        return None, [tree.spot.issue((), message)]
    scope, issues = _scope(tree)
    tree = _with_defaults(tree, scope)
    chosen, of_kinds = _choose(tree, scope)
    tree, of_sheets = with_fields(tree, chosen)
    issues += of_kinds + of_sheets
    known = dict(chosen)
    data = {key: value for key, value in _located(tree, chosen).items() if key in known or key not in AT_TOP}
    model = scenario_model(chosen)
    try:
        scenario = with_radio(model.model_validate(data))
    except ValidationError as error:
        return None, issues + issues_of(error, model, tree)
    scenario._tree = tree
    return (None if issues else scenario), issues


def _scope(tree: LocatedValue) -> tuple[Scope, list[Issue]]:
    """Return which roles the scenario uses."""
    network, kind = tree.at(("network",)), tree.at(("workload", "kind"))
    has_network = network is None or network.value != "none"
    has_targets = kind is None or not _is_without_target(kind)
    if kind is None or has_network or has_targets:
        return Scope(has_network, has_targets), []
    message = "a scenario without a target needs a network: remove 'network: none'"
    return Scope(network=True, targets=False), [kind.spot.issue(("workload", "kind"), message)]


def _model_of(role: str, kind: str, spot: Spot) -> type[PartModel]:
    """Return the model of a kind that the text at the spot may name."""
    demand_class(role, kind, spot.origin.plugins, spot.origin.folder, of_file=bool(spot.origin.lines))
    return part_model(role, kind)


def _is_without_target(kind: LocatedValue) -> bool:
    try:
        return isinstance(kind.value, str) and is_without_target(_model_of("workload", kind.value, kind.spot))
    except (LookupError, ImportError, PartError):
        return False


def _with_defaults(tree: LocatedValue, scope: Scope) -> LocatedValue:
    """Return the tree with an empty mapping for each missing role that has a default kind, or an empty list."""
    spot = tree.spot
    missing = {} if scope.targets else {"step": Entry(spot, LocatedValue(BEACON_STEP, spot))}
    for role in filter(scope.uses, ROLES.values()):
        if role.optional:
            missing[role.listed] = Entry(spot, LocatedValue([], spot))
        elif default := scope.default(role):
            kind = {"kind": Entry(spot, LocatedValue(default, spot))} if default != role.default else {}
            missing[role.name] = Entry(spot, LocatedValue(kind, spot))
            given = tree.child(role.name)
            if kind and given is not None and isinstance(given.value, dict):
                tree = LocatedValue(
                    tree.value | {role.name: Entry(given.spot, LocatedValue(kind | given.value, given.spot))}, spot
                )
    return LocatedValue(missing | tree.value, spot)


def _choose(tree: LocatedValue, scope: Scope) -> tuple[Chosen, list[Issue]]:
    """Return the models of each key by their kinds; a key without a known kind is left out."""
    chosen: dict[str, tuple[type[PartModel] | None, ...]] = {}
    issues: list[Issue] = []
    for key, components in _components(tree, scope, issues):
        models = tuple(_model_at(node, path, AT_TOP[key], issues) for path, node in components)
        if any(models) or not models:
            chosen[key] = models
    return tuple(chosen.items()), issues


def _components(
    tree: LocatedValue, scope: Scope, issues: list[Issue]
) -> Iterator[tuple[str, list[tuple[Keys, LocatedValue]]]]:
    """Yield (key, its components with their paths): one under the name of a role, several under its list."""
    for role in ROLES.values():
        alone = tree.child(role.name) if role.name in role.keys else None
        several = tree.child(role.listed) if role.listed else None
        if several is not None:
            if alone is not None:
                message = f"give either '{role.name}' or '{role.listed}', not both"
                issues.append(tree.spot_of((role.listed,), of_key=True).issue((role.listed,), message))
            items = _items(several, role, issues)
            if items is not None:
                yield role.listed, items
        elif alone is not None:
            yield role.name, [((role.name,), alone)]
        elif scope.uses(role):
            also = f" (or '{role.listed}', a list of them)" if role.listed else ""
            issues.append(tree.spot.issue((role.name,), f"is missing: {role.purpose}{also}"))


def _items(several: LocatedValue, role: Role, issues: list[Issue]) -> list[tuple[Keys, LocatedValue]] | None:
    """Return the items of a list with their paths, or None if it is no list or wrongly empty."""
    if not isinstance(several.value, list) or not (several.value or role.optional):
        if several.value is not BROKEN:
            message = f"expected a list of {role.plural}, got {described(several.plain() or None)}"
            issues.append(several.spot.issue((role.listed,), message))
        return None
    return [((role.listed, i), node) for i, node in enumerate(several.value)]


def _model_at(node: LocatedValue, path: Keys, role: Role, issues: list[Issue]) -> type[PartModel] | None:
    """Return the model of the kind that a node names, with those of the components within it; None with an issue."""
    kind_path = (*path, "kind")
    written = node.child("kind")
    if node.value is BROKEN or (written is not None and written.value is BROKEN):
        return None
    if not isinstance(node.value, dict):
        written_kind = (
            node.value
            if isinstance(node.value, str) and (":" in node.value or node.value in kinds(role.name))
            else None
        )
        example = f"{{kind: {written_kind or role.default or role.kinds[0].kind}}}"
        example += f" or {role.name}.kind={written_kind}" if written_kind and node.spot.origin.name[:2] == "--" else ""
        issues.append(node.spot.issue(path, f"expected a mapping such as {example}, got {described(node.plain())}"))
        return None
    kind = written.plain() if written else role.default
    if not isinstance(kind, str):
        known = "known: " + ", ".join(kinds(role.name))
        problem = f"expected the name of a kind, got {described(kind)}" if written else f"is missing; {known}"
        issues.append((written or node).spot.issue(kind_path, problem))
        return None
    try:
        model = _model_of(role.name, kind, (written or node).spot)
    except (LookupError, ImportError, PartError) as error:
        issues.append((written or node).spot.issue(kind_path, str(error.args[0])))
        return None
    given = [(field, inner, node.child(field)) for field, inner in roles_of(model.part).items()]
    found: list[tuple[str, InnerKinds]] = [
        (field, _inner_at(held, (*path, field), inner, issues)) for field, inner, held in given if held is not None
    ]
    left_out = [(field, ROLES[inner.role].default) for field, inner, held in given if held is None]
    found += [(field, part_model(roles_of(model.part)[field].role, kind)) for field, kind in left_out if kind]
    return with_inner(model, tuple(found))


def _inner_at(node: LocatedValue, path: Keys, inner: Inner, issues: list[Issue]) -> InnerKinds:
    """Return the model of a component within another, or those of a list of components."""
    role = ROLES[inner.role]
    if not inner.several:
        return _model_at(node, path, role, issues)
    if node.value is BROKEN:
        return None
    if not isinstance(node.value, list):
        message = f"expected a list of {role.plural}, got {described(node.plain() or None)}"
        issues.append(node.spot.issue(path, message))
        return None
    return tuple(_model_at(item, (*path, i), role, issues) for i, item in enumerate(node.value))


def _located(tree: LocatedValue, chosen: Chosen) -> dict[str, Any]:
    """Return the plain values; file names (fields `path`, `..._path`) are relative to the folder of their text.

    A component with a field `digest` gets the digest of its file, unless the text gives one.
    """
    data: dict[str, Any] = tree.plain()
    parts = [(path, model.part) for path, model in _chosen_models(chosen)]
    parts += [((*path, name), inner) for path, part in parts for name, inner in nested_of(cast(Any, part)).items()]
    for path, part in parts:
        names = names_of(part)
        for field in filter(is_path, names):
            node = tree.at((*path, field))
            if node is not None and isinstance(node.value, str) and node.value:
                component = functools.reduce(operator.getitem, path, cast(Any, data))
                component[field] = str((node.spot.origin.folder / node.value).resolve())
                if "digest" in names and component.get("digest", "") == "":
                    component["digest"] = digest_or_nothing(component[field])
    return data


def _chosen_models(chosen: Chosen) -> Iterator[tuple[Keys, type[PartModel]]]:
    """Yield every known model with the path of its component, those within others too."""
    for key, models in chosen:
        for i, model in enumerate(models):
            if model is not None:
                yield from _with_inner_models((key, i) if key == AT_TOP[key].listed else (key,), model)


def _with_inner_models(path: Keys, model: type[PartModel]) -> Iterator[tuple[Keys, type[PartModel]]]:
    yield path, model
    for within, inner in inner_models(model).items():
        yield from _with_inner_models((*path, *within), inner)


def digest_or_nothing(file: str) -> str:
    """Return the digest of a file, or '' if it cannot be read: its component says why."""
    try:
        return file_digest(file)
    except OSError:
        return ""


def is_path(field: str) -> bool:
    """Return whether a field of this name holds the name of a file."""
    return field == "path" or field.endswith("_path")
