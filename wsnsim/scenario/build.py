"""From a scenario to a setup: one frozen component per role, checked against each other.

    build(scenario) -> NetworkSetup, BeaconSetup or TrackingSetup
    resolved(scenario) -> dict      plugins(scenario) -> (str, ...)      differing_leaves(resolved, resolved) -> dict

Heavy modules are imported where they are used: `wsnsim list` imports this module.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import Issue, RunError, ScenarioError, UsageError
from wsnsim.scenario.registry import AT_TOP, ROLES, Role, find
from wsnsim.scenario.texts import Keys, in_order

if TYPE_CHECKING:
    from wsnsim.base.setups import BeaconSetup, TrackingSetup
    from wsnsim.scenario.schema import Scenario


def build(scenario: Scenario) -> TrackingSetup | BeaconSetup:
    """Return the setup of a scenario.

    Args:
        scenario: What `load` returned.

    Returns:
        A NetworkSetup; a BeaconSetup for a network without a target; a TrackingSetup for a standalone filter.

    Raises:
        ScenarioError: with every issue that a component finds in itself or in the setup.
        UsageError: it is not what `load` returned.
        PluginAnswerError: a plug-in's component is not what its port says. Its answers are checked from now on.
    """
    from wsnsim.base.border import checked_setup
    from wsnsim.scenario.schema import Scenario, shown_scenario

    if not isinstance(scenario, Scenario):
        raise UsageError(f"scenario: expected what wsnsim.load returned, got {shown_scenario(scenario)}")
    components, issues = _built(scenario)
    issues += _too_short(scenario)
    if issues:
        raise ScenarioError(in_order(issues))
    setup = _setup(scenario, components)
    issues = [
        scenario.spot(issue.path).issue(issue.path, issue.message) for issue in _issues(scenario, setup, components)
    ]
    if issues:
        raise ScenarioError(in_order(issues))
    return checked_setup(setup)


def resolved(scenario: Scenario) -> dict[str, Any]:
    """Return all values of a scenario, defaults included, as plain JSON values in SI units; infinity is '.inf'.

    Loading the result gives an equal scenario.
    """
    plain: dict[str, Any] = plain_json(scenario.model_dump(mode="python"))
    unused = () if scenario.scope.targets else ("lost",)
    return {key: value for key, value in plain.items() if value is not None and key not in unused}


def plugins(scenario: Scenario) -> tuple[str, ...]:
    """Return the kinds that do not come with wsnsim, for provenance: 'tracker mine (mylab 1.0)'."""
    chosen = {pair for role, _, model in _models(scenario) for pair in _kinds_in(role.name, model)}
    infos = [(role, find(role, kind)) for role, kind in sorted(chosen)]
    added = [(role, info) for role, info in infos if info not in ROLES[role].kinds]
    return tuple(f"{role} {info.kind}" + (f" ({info.plugin})" if info.plugin else "") for role, info in added)


def plain_json(value: Any) -> Any:
    """Return the value with lists for tuples and the text '.inf' for infinity."""
    if isinstance(value, dict):
        return {key: plain_json(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [plain_json(inner) for inner in value]
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return value


def _models(scenario: Scenario) -> list[tuple[Role, Keys, Any]]:
    """Return the models of each role that the run uses, with their paths."""
    used = filter(scenario.scope.uses, ROLES.values())
    return [(role, path, model) for role in used for path, model in scenario.written(role)]


def _kinds_in(role: str, model: Any) -> Iterator[tuple[str, str]]:
    """Yield (role, kind) of a model and of the components within it."""
    from wsnsim.scenario.fields import roles_of

    yield role, model.kind
    for field, inner in roles_of(model.part).items():
        held = getattr(model, field)
        for one in held if inner.several else (held,):
            yield from _kinds_in(inner.role, one)


def _built(scenario: Scenario) -> tuple[dict[Keys, Any], list[Issue]]:
    """Return every component by its path, and the issues raised by the classes themselves."""
    from wsnsim.scenario.schema import InvalidComponent, built

    components: dict[Keys, Any] = {}
    issues = []
    for _, path, model in _models(scenario):
        try:
            components[path] = built(model, path)
        except InvalidComponent as error:
            issues.append(scenario.spot(error.path).issue(error.path, str(error)))
    return components, issues


def _too_short(scenario: Scenario) -> Iterator[Issue]:
    """Yield an issue if a run that tracks ends before the first estimate."""
    if scenario.scope.targets and scenario.steps < 2:
        message = (
            f"{scenario.duration:g} s is one step of {scenario.step:g} s, that of the start: a run that tracks has an "
            f"estimate from its second step on; give at least {2 * scenario.step:g} s, or a shorter step"
        )
        yield scenario.spot(("duration",)).issue(("duration",), message)


def _setup(scenario: Scenario, components: dict[Keys, Any]) -> TrackingSetup | BeaconSetup:
    from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup

    scope = scenario.scope
    common = {
        "name": scenario.name,
        "seed": scenario.seed,
        "steps": scenario.steps - 1,
        "dt": scenario.step,
        "record": scenario.model_dump()["record"],
        "unused": tuple(key for key, role in AT_TOP.items() if hasattr(scenario, key) and not scope.uses(role)),
        "faults": tuple(components[path] for path, _ in scenario.written(ROLES["fault"])),
    }
    of_targets = ("motion", "sensor")
    roles = {str(path[0]): part for path, part in components.items() if path[0] in ROLES and path[0] not in of_targets}
    if hasattr(type(roles["deploy"]), "names"):
        with contextlib.suppress(RunError):  # the check of one of them says so
            names = roles["deploy"].names
            if "link" in roles:
                roles["link"] = _joined(roles["link"], names)
            if scope.targets:
                components = components | {("sensor",): _joined(components["sensor",], names)}
    if not scope.targets:
        return BeaconSetup(**common, **roles)
    roles.pop("workload", None)
    tracking = {**common, **roles, **_of_targets(scenario, components)}
    if not scope.network:
        return TrackingSetup(**tracking)
    return NetworkSetup(**tracking, until_clusters=scenario.until.clusters if scenario.until else None)


def _joined(part: Any, names: tuple[str, ...]) -> Any:
    """Return a component whose lists for nodes, and those of the law within it, are in the order of these names."""
    if hasattr(part, "with_nodes"):
        return part.with_nodes(names)
    law = getattr(part, "law", None)
    joined = _joined(law, names) if dataclasses.is_dataclass(law) else law
    return part if joined is law else dataclasses.replace(part, law=joined)


def _of_targets(scenario: Scenario, components: dict[Keys, Any]) -> dict[str, Any]:
    """Return the fields of a setup about targets: motions, sensor, the filter's models, the limit of a lost track."""
    from wsnsim.base.optional_ports import Replays

    sensor = components["sensor",]
    law = sensor.law if isinstance(sensor, Replays) else sensor
    written = scenario.written(ROLES["motion"])
    motions = tuple(components[path] for path, _ in written)
    assumes = scenario.tracker.assumes  # type: ignore[attr-defined]
    diagonal = math.inf
    with contextlib.suppress(Exception):  # what is wrong with the deployment, its check says
        diagonal = components["deploy",].field.diagonal
    return {
        "motions": motions,
        "presence": tuple(model.presence for _, model in written),  # type: ignore[attr-defined]
        "sensor": law,
        "recorded": sensor if isinstance(sensor, Replays) else None,
        "filter_motions": tuple(motion.assumed(assumes.noise_scale) for motion in motions),
        "filter_sensor": sensor.assumed(assumes.gains, assumes.inflate),
        "lost_window": scenario.lost.lasting(scenario.step),
        "lost_limit": scenario.lost.beyond(law.reach, diagonal),
    }


def _issues(scenario: Scenario, setup: TrackingSetup | BeaconSetup, components: dict[Keys, Any]) -> Iterator[Issue]:
    """Yield the issues that the components find in the setup, each once."""
    from wsnsim.base.setups import TrackingSetup
    from wsnsim.scenario.abilities import impossible_combinations, missing_abilities

    yield from _out_of_scope(scenario)
    found = {
        dataclasses.replace(issue, path=_within(path, issue.path))
        for path, part in components.items()
        if hasattr(part, "check")
        for issue in part.check(setup)
    }
    yield from sorted(found, key=lambda issue: ([str(key) for key in issue.path], issue.message))
    if not scenario.scope.network:
        yield from _beyond_sensors(components)
    yield from impossible_combinations(setup)
    if isinstance(setup, TrackingSetup):
        yield from missing_abilities(scenario, setup)
        yield from _other_columns(scenario, setup)
        yield from _presence_issues(scenario, setup)


def _within(path: Keys, named: Keys) -> Keys:
    """Return the path of an issue; where a component in a list names its role or list, with its index."""
    role = AT_TOP[str(path[0])]
    of_itself = len(path) > 1 and bool(named) and named[0] in (role.name, role.listed)
    return (*path, *named[1:]) if of_itself else named


def _out_of_scope(scenario: Scenario) -> Iterator[Issue]:
    """Yield an issue for each key about clusters or tracks in a scenario that has none."""
    if not scenario.scope.network and scenario.until:
        yield Issue(("until",), "without a network there are no clusters to end at")
    if not scenario.scope.targets:
        if scenario.until:
            yield Issue(("until",), "without a target there are no clusters to end at")
        if "lost" in scenario.model_fields_set:
            yield Issue(("lost",), "without a target there is no track that could be lost")


def _beyond_sensors(components: dict[Keys, Any]) -> Iterator[Issue]:
    """Yield an issue for each fault that acts on what only a network has."""
    from wsnsim.scenario.abilities import kinds_with

    for path, part in components.items():
        if path[0] == ROLES["fault"].listed and not getattr(part, "standalone", False):
            message = "acts on batteries, radios, clocks or messages, and without a network there are sensors alone"
            yield Issue(
                (*path, "kind"), f"{message}; these act on sensors: {', '.join(kinds_with('fault', 'standalone'))}"
            )


def _other_columns(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue for each target whose state has other columns than that of the first."""
    first = setup.motions[0].columns
    for (path, _), motion in zip(scenario.written(ROLES["motion"]), setup.motions, strict=True):
        if motion.columns != first:
            names = " ".join(motion.columns), " ".join(first)
            yield Issue(path, f"its state is ({names[0]}), the first target's ({names[1]}): all must have the same")


def _presence_issues(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue for intervals that are not disjoint and ascending, and for absences where nothing follows them."""
    from wsnsim.base.setups import NetworkSetup

    for (path, _), intervals in zip(scenario.written(ROLES["motion"]), setup.presence, strict=True):
        instants = [instant for interval in intervals or () for instant in interval]
        if sorted(set(instants)) != instants:
            shown = ", ".join(f"[{begin:g}, {end:g}]" for begin, end in intervals or ())
            yield Issue(
                (*path, "presence"), f"must be disjoint, ascending intervals in s that begin and end: got {shown}"
            )
        if setup.recorded is not None and intervals is not None:
            yield Issue((*path, "presence"), "readings were recorded: they say when the target was there; remove it")
    if setup.has_absences and not isinstance(setup, NetworkSetup):
        message = "a target may be absent, and a filter without a network has no track initiation: it needs a network"
        yield Issue(scenario.written(ROLES["motion"])[0][0], message)
    for i, model in enumerate(getattr(scenario.tracker, "models", ())):  # type: ignore[attr-defined]
        if model.presence is not None:
            yield Issue(("tracker", "models", i, "presence"), "a mode of a filter has none: targets have")


ABSENT: Final = "(absent)"


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of every value that is not a mapping."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for number, inner in enumerate(value):
            yield from leaves(inner, f"{path}.{number}")
    else:
        yield path, value


def differing_leaves(a: Mapping[str, Any], b: Mapping[str, Any], but: Sequence[str] = ()) -> dict[str, tuple[Any, Any]]:
    """{dotted key: (A, B)} of the values that differ; what only one of them has is `ABSENT` in the other."""
    sides = [dict(leaves(dict(each))) for each in (a, b)]
    keys = [*sides[0], *(key for key in sides[1] if key not in sides[0])]
    pairs = {key: (sides[0].get(key, ABSENT), sides[1].get(key, ABSENT)) for key in keys if key not in but}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}
