"""A tree is checked against what scenarios may say.

    validate(tree) -> (Scenario or None, faults)

Which kinds a scenario chooses is settled first; the model for just these kinds then finds every other fault in one
pass.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError

from wsnsim.base.errors import Fault
from wsnsim.scenario.catalog import BENCH_ROLES, ROLES, kinds
from wsnsim.scenario.fields import PartError, described, fields_of
from wsnsim.scenario.messages import faults_of
from wsnsim.scenario.schema import Chosen, PartModel, Scenario, part_model, scenario_model
from wsnsim.scenario.tree import BROKEN, Entry, Keys, Node, child, mapping, plain, spot_of


def validate(tree: Node) -> tuple[Scenario | None, list[Fault]]:
    """The scenario that a tree says, or every fault of it."""
    if not isinstance(tree.value, dict):
        message = f"expected keys such as 'name', got {described(plain(tree))}"
        return None, [] if tree.value is BROKEN else [tree.spot.fault((), message)]
    tree = _with_defaults(tree)
    chosen, faults = _choose(tree)
    settled = {role for role, _ in chosen}
    model = scenario_model(chosen)
    data = _located(tree, chosen)
    for role in (*ROLES, "targets"):
        if role not in settled:
            data.pop(role, None)
    try:
        scenario = model.model_validate(data)
    except ValidationError as error:
        return None, faults + faults_of(error, model, tree)
    scenario._tree = tree
    return (None if faults else scenario), faults


def _with_defaults(tree: Node) -> Node:
    """The tree with an empty mapping for each role that is left out and has a default kind."""
    if _on_bench(tree):
        deploy = {"kind": Entry(tree.spot, Node(ROLES["deploy"].bench_default, tree.spot))}
        missing = {name: Entry(tree.spot, Node({}, tree.spot)) for name in BENCH_ROLES if ROLES[name].default}
        missing["deploy"] = Entry(tree.spot, Node(deploy, tree.spot))
        given = child(tree, "deploy")
        if given is not None and isinstance(given.value, dict) and "kind" not in given.value:
            tree = mapping(
                tree.value | {"deploy": Entry(given.spot, mapping(deploy | given.value, given.spot))}, tree.spot
            )
    else:
        missing = {name: Entry(tree.spot, Node({}, tree.spot)) for name, role in ROLES.items() if role.default}
    return mapping(missing | tree.value, tree.spot)


def _on_bench(tree: Node) -> bool:
    """Whether the scenario says `network: none`."""
    said = child(tree, "network")
    return said is not None and said.value == "none"


def _choose(tree: Node) -> tuple[Chosen, list[Fault]]:
    """Each role's model, by its kind; a role whose kind is at fault is left out."""
    chosen: dict[str, tuple[type[PartModel] | None, ...]] = {}
    faults: list[Fault] = []
    for name, path_and_node in _role_nodes(tree, faults):
        found = tuple(_model_at(node, path, faults) for path, node in path_and_node)
        if any(found):
            chosen[name] = found
    return tuple(chosen.items()), faults


def _role_nodes(tree: Node, faults: list[Fault]) -> Iterator[tuple[str, list[tuple[Keys, Node]]]]:
    """(role, its mappings with their paths); `targets` has several."""
    targets = child(tree, "targets")
    for role in ROLES:
        node = child(tree, role)
        if role == "motion" and targets is not None:
            if node is not None:
                spot = spot_of(tree, ("targets",), of_key=True)
                faults.append(spot.fault(("targets",), "give either 'motion' or 'targets', not both"))
            yield "targets", _target_nodes(targets, faults)
        elif node is None and ROLES[role].of_network and _on_bench(tree):
            continue
        elif node is None:
            also = " (or 'targets', a list of them)" if role == "motion" else ""
            faults.append(tree.spot.fault((role,), f"is missing: {ROLES[role].purpose}{also}"))
        else:
            yield role, [((role,), node)]


def _target_nodes(targets: Node, faults: list[Fault]) -> list[tuple[Keys, Node]]:
    if not isinstance(targets.value, list) or not targets.value:
        if targets.value is not BROKEN:
            message = f"expected a list of motions, got {described(plain(targets) or None)}"
            faults.append(targets.spot.fault(("targets",), message))
        return []
    return [(("targets", i), node) for i, node in enumerate(targets.value)]


def _model_at(node: Node, path: Keys, faults: list[Fault]) -> type[PartModel] | None:
    role = ROLES["motion" if path[0] == "targets" else str(path[0])]
    kind_path = (*path, "kind")
    written = child(node, "kind")
    if node.value is BROKEN or (written is not None and written.value is BROKEN):
        return None
    if not isinstance(node.value, dict):
        example = f"{{kind: {role.default or role.rows[0].kind}}}"
        faults.append(node.spot.fault(path, f"expected a mapping such as {example}, got {described(plain(node))}"))
        return None
    kind = plain(written) if written else role.default
    if not isinstance(kind, str):
        known = "known: " + ", ".join(kinds(role.name))
        problem = f"expected the name of a kind, got {described(kind)}" if written else f"is missing; {known}"
        faults.append((written or node).spot.fault(kind_path, problem))
        return None
    try:
        return part_model(role.name, kind)
    except (LookupError, ImportError, PartError) as error:
        faults.append((written or node).spot.fault(kind_path, str(error.args[0])))
        return None


def _located(tree: Node, chosen: Chosen) -> dict[str, Any]:
    """The plain values; file names (fields `path`, `..._path`) are taken from the folder of the text they stand in."""
    data: dict[str, Any] = plain(tree)
    for role, (model, *_) in chosen:
        if role == "targets" or model is None:
            continue
        for field in (name for name in fields_of(model.part) if name == "path" or name.endswith("_path")):
            node = child(tree.value[role].node, field)
            if node is not None and isinstance(node.value, str) and node.value:
                data[role][field] = str((node.spot.text.folder / node.value).resolve())
    return data
