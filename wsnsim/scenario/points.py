"""The points of a sweep: scenarios with values assigned, each checked, with a unique name.

points_of(bases, common, settings) -> [Point, ...]
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.base.regular_files import read_regular
from wsnsim.scenario.axes import Settings
from wsnsim.scenario.build import build, resolved
from wsnsim.scenario.load import Assignment, ScenarioText, validated
from wsnsim.scenario.located_values import Keys, LocatedValue, dotted, in_order, plain
from wsnsim.scenario.schema import Scenario
from wsnsim.scenario.sweep_schema import Point

LEFT_OUT: Final = ("name", "replicates")
"""Keys of a scenario that change none of its runs."""
WORLD: Final = (
    "seed", "step", "duration", "deploy", "motion", "targets", "sensor", "prior", "detection", "faults",
)  # fmt: skip
"""Keys that two points must share to have the same ground truth, deployment, readings and prior."""
BELIEF: Final = "position_error"
"""The key of `deploy` that changes what filters assume, and nothing that happens."""
SCENARIO: Final = "scenario"
MOST_ISSUES: Final = 20


class PointName(NamedTuple):
    """A column and its text, which stand for the values of these keys among a point's settings."""

    column: str
    text: str
    keys: frozenset[str]


def points_of(
    bases: Sequence[ScenarioText],
    common: Sequence[Assignment],
    settings: Iterable[Settings],
    names: Sequence[PointName] | None = None,
) -> list[Point]:
    """Return one point per base and settings; with several bases, their names are a column.

    Args:
        bases: the scenarios.
        common: the assignments of every point.
        settings: the assignments that distinguish points.
        names: what stands for some of them, one for each settings; None for the values themselves.

    Raises:
        ScenarioError: with the different issues of all points, and points that are equal.
    """
    issues: dict[Keys, Issue] = {}
    points: dict[str, Point] = {}
    chosen = list(settings)
    for base in bases:
        for number, laid in enumerate(chosen):
            try:
                scenario = validated(base, [*common, *laid])
                build(scenario)
            except ScenarioError as error:
                for issue in error.issues:  # if all values of an axis have the same issue, the first is reported
                    issues.setdefault((issue.place.rsplit(":", 2)[0], *issue.path, issue.message), issue)
                if len(issues) >= MOST_ISSUES:
                    raise ScenarioError(in_order(issues.values())) from None
                continue
            first = {SCENARIO: scenario.name} if len(bases) > 1 else {}
            point = _point(scenario, laid, first, names[number] if names else None)
            twin = points.setdefault(point.id, point)
            if twin is not point:
                message = f"{_words(twin)} and {_words(point)} are the same point: they differ in nothing"
                keys, node = laid[-1] if laid else ((), None)
                issues.setdefault((message,), node.spot.issue(keys, message) if node else Issue((), message))
    if issues:
        raise ScenarioError(in_order(issues.values()))
    return list(points.values())


def reals_of(bases: Iterable[ScenarioText], common: Sequence[Assignment]) -> Callable[[Keys], bool]:
    """Return a function: whether a key holds a real number in every scenario that is valid without the axes."""
    content = []
    for base in bases:
        with contextlib.suppress(ScenarioError):  # a value may be missing that an axis gives
            content.append(resolved(validated(base, common)))
    return lambda keys: bool(content) and all(isinstance(_value_at(values, keys), float) for values in content)


def demand_no_axis(assignments: Iterable[Assignment], settings: Iterable[Settings]) -> None:
    """Refuse a --set that every point would replace.

    Raises:
        ScenarioError: with an issue for each.
    """
    varied = {keys for laid in settings for keys, _ in laid}
    message = "is an axis of this sweep; --vary takes other values for it"
    issues = [node.spot.issue(keys, message) for keys, node in assignments if keys in varied]
    if issues:
        raise ScenarioError(issues)


def keys_of_points(points: Iterable[Point]) -> tuple[str, ...]:
    """Return the columns that distinguish points, in the order of their first use."""
    return tuple(dict.fromkeys(key for point in points for key in point.settings))


def _point(scenario: Scenario, laid: Settings, first: Mapping[str, Any], name: PointName | None) -> Point:
    content = resolved(scenario)
    decides = {key: value for key, value in content.items() if key not in LEFT_OUT}
    world = {key: content.get(key) for key in WORLD}
    world["deploy"] = {key: value for key, value in content["deploy"].items() if key != BELIEF}
    values = {name: value for keys, node in laid for name, value in _leaves(keys, node, content)}
    if name is not None:
        kept = {key: value for key, value in values.items() if key not in name.keys}
        values = {name.column: name.text, **kept}
    return Point(_digest(decides), {**first, **values}, json.dumps(content), _digest(world))


def _leaves(keys: Keys, node: LocatedValue, content: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return (column, value in SI units) of all values of one setting; of a whole role, each of its keys."""
    if isinstance(node.value, dict):
        return [leaf for key, entry in node.value.items() for leaf in _leaves((*keys, key), entry.node, content)]
    value = _value_at(content, keys, plain(node))  # a short form is stored elsewhere in the scenario
    return [(dotted(keys), json.dumps(value) if isinstance(value, list | dict) else value)]


def _value_at(content: Any, keys: Keys, default: Any = None) -> Any:
    """Return the value of a resolved scenario at a path."""
    for key in keys:
        try:
            content = content[key]
        except (KeyError, IndexError, TypeError):
            return default
    return content


def _words(point: Point) -> str:
    return ", ".join(f"{key} = {value}" for key, value in point.settings.items()) or "(the scenario as it is)"


def _digest(values: Mapping[str, Any]) -> str:
    """Return a digest of the values; of files, the content counts, not the name."""
    text = json.dumps(_by_content(values), sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=6).hexdigest()


def _by_content(value: Any, key: str = "") -> Any:
    if isinstance(value, Mapping):
        return {name: _by_content(inner, str(name)) for name, inner in value.items()}
    if isinstance(value, list):
        return [_by_content(item) for item in value]
    if isinstance(value, str) and (key == "path" or key.endswith("_path")):
        with contextlib.suppress(OSError):
            return hashlib.blake2b(read_regular(value), digest_size=16).hexdigest()
    return value
