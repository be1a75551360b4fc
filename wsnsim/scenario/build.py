"""A scenario becomes parts: one frozen object a role, asked whether they can live together.

    build(scenario) -> Parts, Beacons or Problem;  resolved(scenario) -> dict;  plugins(scenario) -> (str, ...)

Nothing heavy is imported before it is used: `wsnsim list` passes through here.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.scenario.registry import ROLES, Role, find

if TYPE_CHECKING:
    from wsnsim.base.setups import BeaconSetup, Setup, TrackingSetup
    from wsnsim.scenario.schema import Scenario

Keys = tuple[str | int, ...]


def build(scenario: Scenario) -> TrackingSetup | BeaconSetup:
    """The scenario's parts: `Parts` for a network, `Beacons` for one without a target, a bare `Problem` for a bench.

    Raises:
        ScenarioError: with every fault that a part finds in itself or in the company of the others.
    """
    from wsnsim.scenario.located_values import in_order

    made, issues = _made(scenario)
    if issues:
        raise ScenarioError(in_order(issues))
    parts = _parts(scenario, made)
    issues = [scenario.spot(issue.path).issue(issue.path, issue.message) for issue in _found(scenario, parts, made)]
    if issues:
        raise ScenarioError(in_order(issues))
    return parts


def resolved(scenario: Scenario) -> dict[str, Any]:
    """Everything the scenario says, defaults included, as plain JSON values in SI units; infinity is the text '.inf'.

    Loading it again gives an equal scenario.
    """
    plain: dict[str, Any] = plain_json(scenario.model_dump(mode="python"))
    unsaid = () if scenario.scope.targets else ("lost",)
    return {key: value for key, value in plain.items() if value is not None and key not in unsaid}


def plugins(scenario: Scenario) -> tuple[str, ...]:
    """The kinds that did not come with wsnsim, for provenance: 'tracker mine (mylab 1.0)'."""
    chosen = {(role.name, model.kind) for role, _, model in _models(scenario)}
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


def _models(scenario: Scenario) -> list[tuple[Role, Keys, Any]]:
    """Each role that the run uses, with the path and the model of what stands behind it."""
    used = filter(scenario.scope.uses, ROLES.values())
    return [(role, path, model) for role in used for path, model in scenario.written(role)]


def _made(scenario: Scenario) -> tuple[dict[Keys, Any], list[Issue]]:
    """Every part by its path; and what the classes themselves refuse."""
    from wsnsim.scenario.schema import Refused, built

    made: dict[Keys, Any] = {}
    issues = []
    for _, path, model in _models(scenario):
        try:
            made[path] = built(model, path)
        except Refused as refused:
            issues.append(scenario.spot(refused.path).issue(refused.path, str(refused)))
    return made, issues


def _parts(scenario: Scenario, made: dict[Keys, Any]) -> TrackingSetup | BeaconSetup:
    from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup

    scope = scenario.scope
    common = {
        "name": scenario.name,
        "seed": scenario.seed,
        "steps": scenario.steps,
        "dt": scenario.step,
        "record": scenario.model_dump()["record"],
    }
    if scope.network:
        common["faults"] = tuple(made[path] for path, _ in scenario.written(ROLES["fault"]))
    roles = {str(path[0]): part for path, part in made.items() if path[0] in ROLES and path[0] != "motion"}
    if not scope.targets:
        return BeaconSetup(**common, **roles)
    roles.pop("workload", None)
    problem = {**common, **roles, **_of_targets(scenario, made)}
    if not scope.network:
        return TrackingSetup(**problem)
    return NetworkSetup(**problem, until_clusters=scenario.until.clusters if scenario.until else None)


def _of_targets(scenario: Scenario, made: dict[Keys, Any]) -> dict[str, Any]:
    """What moves, what its filter believes of it, and when its track counts as lost."""
    motions = tuple(made[path] for path, _ in scenario.written(ROLES["motion"]))
    assumes = scenario.tracker.assumes  # type: ignore[attr-defined]
    return {
        "motions": motions,
        "filter_motions": tuple(motion.assumed(assumes.noise_scale) for motion in motions),
        "filter_sensor": made["sensor",].assumed(assumes.gains, assumes.inflate),
        "lost_window": scenario.lost.window,
        "lost_limit": scenario.lost.limit,
    }


def _found(scenario: Scenario, parts: TrackingSetup | BeaconSetup, made: dict[Keys, Any]) -> Iterator[Issue]:
    """What the parts say of one another, each fault once."""
    from wsnsim.base.setups import TrackingSetup

    yield from _out_of_scope(scenario)
    said = {
        dataclasses.replace(issue, path=_within(path, issue.path))
        for path, part in made.items()
        for issue in _checked(part, parts)
    }
    yield from sorted(said, key=lambda issue: ([str(key) for key in issue.path], issue.message))
    if isinstance(parts, TrackingSetup):
        yield from _lacking(scenario, parts)
        yield from _other_columns(scenario, parts)


def _checked(part: Any, setup: Setup) -> Iterable[Issue]:
    """Return what a component finds wrong with the setup; `faults` is the old name of a plug-in's `check`."""
    if hasattr(part, "check"):
        return part.check(setup)
    if hasattr(part, "faults"):
        warnings.warn(f"{type(part).__name__}.faults is now named check", DeprecationWarning, stacklevel=2)
        return part.faults(setup)
    return ()


def _within(path: Keys, said: Keys) -> Keys:
    """The path of a fault, where a part of a list names its list or its role: with its place in the list."""
    from wsnsim.scenario.kinds import AT_TOP

    role = AT_TOP[str(path[0])]
    of_itself = len(path) > 1 and bool(said) and said[0] in (role.name, role.listed)
    return (*path, *said[1:]) if of_itself else said


def _out_of_scope(scenario: Scenario) -> Iterator[Issue]:
    """What is said of clusters and tracks where there are none."""
    if not scenario.scope.network and scenario.until:
        yield Issue(("until",), "without a network there are no clusters to end at")
    if not scenario.scope.targets:
        if scenario.until:
            yield Issue(("until",), "without a target there are no clusters to end at")
        if "lost" in scenario.model_fields_set:
            yield Issue(("lost",), "without a target there is no track that could be lost")


def _other_columns(scenario: Scenario, parts: TrackingSetup) -> Iterator[Issue]:
    """Targets whose state is not that of the first."""
    first = parts.motions[0].columns
    for (path, _), motion in zip(scenario.written(ROLES["motion"]), parts.motions, strict=True):
        if motion.columns != first:
            names = " ".join(motion.columns), " ".join(first)
            yield Issue(path, f"its state is ({names[0]}), the first target's ({names[1]}): all must have the same")


def _lacking(scenario: Scenario, parts: TrackingSetup) -> Iterator[Issue]:
    """What the tracker needs of its sensor, and what it assumes of it, where the sensor has no such thing."""
    sensor, tracker = scenario.sensor, scenario.tracker  # type: ignore[attr-defined]
    for ability in getattr(parts.tracker, "needs", ()):
        if not callable(getattr(parts.filter_sensor, ability, None)):
            able = ", ".join(_kinds_with("sensor", ability)) or "none that is known"
            yield Issue(
                ("tracker", "kind"),
                f"{tracker.kind} needs a sensor that gives '{ability}', and {sensor.kind} does not; it can use: {able}",
            )
    if tracker.assumes.gains != "known" and "gain" not in parts.sensor.trait_names:
        yield Issue(("tracker", "assumes", "gains"), f"{sensor.kind} has no gains that could be unknown")


def _kinds_with(role: str, ability: str) -> Iterator[str]:
    """The kinds of a role whose class has a method of this name."""
    from wsnsim.scenario.registry import kinds, load_class

    for row in kinds(role).values():
        try:
            if callable(getattr(load_class(row), ability, None)):
                yield row.kind
        except ImportError:
            continue
