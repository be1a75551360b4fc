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
    from wsnsim.base.ports import Problem
    from wsnsim.scenario.schema import Scenario


def build(scenario: Scenario) -> Problem:
    """The scenario's parts: `Parts`, ready for the network, or the bare `Problem` of one without.

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
    plain: dict[str, Any] = plain_json(scenario.model_dump(mode="python"))
    return {key: value for key, value in plain.items() if value is not None}


def plugins(scenario: Scenario) -> tuple[str, ...]:
    """The kinds that did not come with wsnsim, for provenance: 'tracker mine (mylab 1.0)'."""
    models = [*_models(scenario), *(("motion", model) for _, model in scenario.targets_given)]
    chosen = {(role, model.kind) for role, model in models}
    rows = [(role, find(role, kind)) for role, kind in sorted(chosen)]
    added = [(role, row) for role, row in rows if row not in ROLES[role].rows]
    return tuple(f"{role} {row.kind}" + (f" ({row.plugin})" if row.plugin else "") for role, row in added)


def plain_json(value: Any) -> Any:
    """The value with lists for tuples, and infinity as the text '.inf'."""
    if isinstance(value, dict):
        return {key: plain_json(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [plain_json(inner) for inner in value]
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return value


def _models(scenario: Scenario) -> list[tuple[str, Any]]:
    """Each role but the motion, with its model, if the run uses it."""
    used = [role for role in ROLES if role != "motion" and not (scenario.network and ROLES[role].of_network)]
    return [(role, getattr(scenario, role)) for role in used]


def _made(scenario: Scenario) -> tuple[dict[tuple[str | int, ...], Any], list[Fault]]:
    """Every part by its path; and what the classes themselves refuse."""
    from wsnsim.scenario.schema import built

    models = [((role,), model) for role, model in _models(scenario)]
    made: dict[tuple[str | int, ...], Any] = {}
    faults = []
    for path, model in [*models, *scenario.targets_given]:
        try:
            made[path] = built(model)
        except (ValueError, TypeError) as error:
            faults.append(scenario.spot(path).fault(path, str(error) or type(error).__name__))
    return made, faults


def _parts(scenario: Scenario, made: dict[tuple[str | int, ...], Any]) -> Problem:
    from wsnsim.base.ports import Parts, Problem

    roles = {str(path[0]): part for path, part in made.items() if path[0] not in ("motion", "targets")}
    motions = tuple(made[path] for path, _ in scenario.targets_given)
    assumes = scenario.tracker.assumes  # type: ignore[attr-defined]
    problem = {
        "name": scenario.name,
        "seed": scenario.seed,
        "steps": scenario.steps,
        "dt": scenario.step,
        "motions": motions,
        "filter_motions": tuple(motion.assumed(assumes.noise_scale) for motion in motions),
        "filter_sensor": roles["sensor"].assumed(assumes.gains, assumes.inflate),
        "record": scenario.model_dump()["record"],
        "lost_window": scenario.lost.window,
        "lost_limit": scenario.lost.limit,
        **roles,
    }
    if scenario.network:
        return Problem(**problem)
    return Parts(**problem, until_clusters=scenario.until.clusters if scenario.until else None)


def _found(scenario: Scenario, parts: Problem) -> Iterator[Fault]:
    """What the parts say of one another, each fault once."""
    asked = [getattr(parts, role) for role, _ in _models(scenario)]
    yield from _lacking(scenario, parts)
    if scenario.network and scenario.until:
        yield Fault(("until",), "without a network there are no clusters to end at")
    said = {fault for part in [*asked, *parts.motions] if hasattr(part, "faults") for fault in part.faults(parts)}
    yield from sorted(said, key=lambda fault: ([str(key) for key in fault.path], fault.message))
    first = parts.motions[0].columns
    for (path, _), motion in zip(scenario.targets_given, parts.motions, strict=True):
        if motion.columns != first:
            names = " ".join(motion.columns), " ".join(first)
            yield Fault(path, f"its state is ({names[0]}), the first target's ({names[1]}): all must have the same")


def _lacking(scenario: Scenario, parts: Problem) -> Iterator[Fault]:
    """What the tracker needs of its sensor, and what it assumes of it, where the sensor has no such thing."""
    sensor, tracker = scenario.sensor, scenario.tracker  # type: ignore[attr-defined]
    for ability in getattr(parts.tracker, "needs", ()):
        if not callable(getattr(parts.filter_sensor, ability, None)):
            able = ", ".join(_kinds_with("sensor", ability)) or "none that is known"
            yield Fault(
                ("tracker", "kind"),
                f"{tracker.kind} needs a sensor that gives '{ability}', and {sensor.kind} does not; it can use: {able}",
            )
    if tracker.assumes.gains != "known" and "gain" not in parts.sensor.trait_names:
        yield Fault(("tracker", "assumes", "gains"), f"{sensor.kind} has no gains that could be unknown")


def _kinds_with(role: str, ability: str) -> Iterator[str]:
    """The kinds of a role whose class has a method of this name."""
    from wsnsim.scenario.catalog import kinds, load_class

    for row in kinds(role).values():
        try:
            if callable(getattr(load_class(row), ability, None)):
                yield row.kind
        except ImportError:
            continue
