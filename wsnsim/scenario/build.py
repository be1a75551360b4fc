"""A scenario becomes parts: one frozen object a role, asked whether they can live together.

    build(scenario) -> Parts;  resolved(scenario) -> dict;  plugins(scenario) -> (str, ...)

Nothing heavy is imported before it is used: `wsnsim list` passes through here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from wsnsim.base.errors import Fault, ScenarioError
from wsnsim.scenario.catalog import ROLES, find

if TYPE_CHECKING:
    from wsnsim.base.ports import Parts
    from wsnsim.scenario.schema import Scenario


def build(scenario: Scenario) -> Parts:
    """The scenario's parts, ready for the network.

    Raises:
        ScenarioError: with every fault that a part finds in itself or in the company of the others.
    """
    from wsnsim.scenario.tree import in_order

    made, faults = _made(scenario)
    if faults:
        raise ScenarioError(in_order(faults))
    parts = _parts(scenario, made)
    faults = [scenario.spot(fault.path).fault(fault.path, fault.message) for fault in _found(scenario, parts)]
    if faults:
        raise ScenarioError(in_order(faults))
    return parts


def resolved(scenario: Scenario) -> dict[str, Any]:
    """Everything the scenario says, defaults included, as plain JSON values in SI units; infinity is the text '.inf'.

    Loading it again gives an equal scenario.
    """
    plain: dict[str, Any] = _json(scenario.model_dump(mode="python"))
    return {key: value for key, value in plain.items() if value is not None}


def plugins(scenario: Scenario) -> tuple[str, ...]:
    """The kinds that did not come with wsnsim, for provenance: 'tracker mine (mylab 1.0)'."""
    models = [(role, getattr(scenario, role)) for role in ROLES if role != "motion"]
    chosen = {(role, model.kind) for role, model in [*models, *(("motion", m) for _, m in scenario.targets_given)]}
    rows = [(role, find(role, kind)) for role, kind in sorted(chosen)]
    added = [(role, row) for role, row in rows if row not in ROLES[role].rows]
    return tuple(f"{role} {row.kind}" + (f" ({row.plugin})" if row.plugin else "") for role, row in added)


def _json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _json(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_json(inner) for inner in value]
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return value


def _made(scenario: Scenario) -> tuple[dict[tuple[str | int, ...], Any], list[Fault]]:
    """Every part by its path; and what the classes themselves refuse."""
    from wsnsim.scenario.schema import built

    models = [((role,), getattr(scenario, role)) for role in ROLES if role != "motion"]
    made: dict[tuple[str | int, ...], Any] = {}
    faults = []
    for path, model in [*models, *scenario.targets_given]:
        try:
            made[path] = built(model)
        except (ValueError, TypeError) as error:
            faults.append(scenario.spot(path).fault(path, str(error) or type(error).__name__))
    return made, faults


def _parts(scenario: Scenario, made: dict[tuple[str | int, ...], Any]) -> Parts:
    from wsnsim.base.ports import Parts

    roles = {str(path[0]): part for path, part in made.items() if path[0] not in ("motion", "targets")}
    motions = tuple(made[path] for path, _ in scenario.targets_given)
    assumes = scenario.tracker.assumes  # type: ignore[attr-defined]
    return Parts(
        name=scenario.name,
        seed=scenario.seed,
        steps=scenario.steps,
        dt=scenario.step,
        motions=motions,
        filter_motions=tuple(motion.assumed(assumes.noise_scale) for motion in motions),
        filter_sensor=roles["sensor"].assumed(assumes.gains, assumes.inflate),
        until_clusters=scenario.until.clusters if scenario.until else None,
        record=scenario.model_dump()["record"],
        **roles,
    )


def _found(scenario: Scenario, parts: Parts) -> Iterator[Fault]:
    """What the parts say of one another, each fault once."""
    asked = [getattr(parts, role) for role in ROLES if role != "motion"]
    said = {fault for part in [*asked, *parts.motions] if hasattr(part, "faults") for fault in part.faults(parts)}
    yield from sorted(said, key=lambda fault: ([str(key) for key in fault.path], fault.message))
    first = parts.motions[0].columns
    for (path, _), motion in zip(scenario.targets_given, parts.motions, strict=True):
        if motion.columns != first:
            names = " ".join(motion.columns), " ".join(first)
            yield Fault(path, f"its state is ({names[0]}), the first target's ({names[1]}): all must have the same")
