"""The points of a sweep: scenarios with values assigned, each checked, with a unique name; and their blocks.

points_of(bases, common, settings) -> [Point, ...]

found = Findings(tree)
combined(tree, written, found) -> the settings of every point, of the blocks that are valid
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, final

from wsnsim.base.errors import Issue, ScenarioError, dotted
from wsnsim.base.files import read_regular
from wsnsim.scenario import axes as shapes
from wsnsim.scenario.axes import Axes, InvalidAxis, Settings
from wsnsim.scenario.build import build, resolved
from wsnsim.scenario.check import validated
from wsnsim.scenario.load import keys_of
from wsnsim.scenario.schema import Scenario
from wsnsim.scenario.sweep_schema import Point, SweepText
from wsnsim.scenario.texts import Assignment, Entry, Keys, LocatedValue, ScenarioText, in_order

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
    value = value_at(content, keys, node.plain())  # a short form is stored elsewhere in the scenario
    return [(dotted(keys), json.dumps(value) if isinstance(value, list | dict) else value)]


def value_at(content: Any, keys: Keys, default: Any = None) -> Any:
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


BLOCKS: Final = (("grid",), ("zip",), ("random", "over"), ("latin_hypercube", "over"))
"""The blocks of a sweep that hold axes."""


@final
class Findings:
    """The issues of a sweep.

    Attributes:
        tree: the sweep as it is checked, which gives issues their paths.
    """

    def __init__(self, tree: LocatedValue) -> None:
        self.tree = tree
        self._issues: list[Issue] = []

    def __len__(self) -> int:
        return len(self._issues)

    def add(self, issues: Iterable[Issue]) -> None:
        """Add issues."""
        self._issues += issues

    @contextlib.contextmanager
    def collected(self) -> Iterator[None]:
        """Add the issues of an error that is raised within, and go on after it."""
        try:
            yield
        except InvalidAxis as refused:
            self.add([refused.within(self.tree)])
        except ScenarioError as error:
            self.add(error.issues)

    def demand_none(self) -> None:
        """Raise ScenarioError with all issues, if there are any."""
        if self._issues:
            raise ScenarioError(in_order(self._issues))


def assignments_in(node: LocatedValue | None, found: Findings) -> list[Assignment]:
    """Return the assignments of a mapping of dotted keys, of those keys that are valid."""
    assignments = []
    for key, entry in node.value.items() if node is not None and isinstance(node.value, dict) else ():
        with found.collected():
            assignments.append((_keys(key, entry), entry.node))
    return assignments


def with_reals(tree: LocatedValue, bases: Iterable[ScenarioText], common: Sequence[Assignment]) -> LocatedValue:
    """Return the tree with ranges of real numbers wherever the scenarios have a real number at the key."""
    scenarios = []
    for base in bases:
        with contextlib.suppress(ScenarioError):  # a value may be missing that an axis gives
            scenarios.append(resolved(validated(base, common)))
    for block in BLOCKS:
        axes = tree.at(block)
        for key, entry in axes.value.items() if axes is not None else ():
            if scenarios and all(isinstance(value_at(one, keys_of(key)), float) for one in scenarios):
                tree = tree.assigned((*block, key), shapes.of_reals(entry.node))
    return tree


def combined(tree: LocatedValue, written: SweepText | None, found: Findings) -> list[Settings]:
    """Return the settings of every point: all combinations of the blocks; none if they are too many.

    Args:
        tree: the sweep.
        written: its checked keys; None if they are invalid, and blocks of random points are left out.
        found: gets the issues.
    """
    blocks = [*_listed(tree, found), *(_sampled(tree, written, found) if written is not None else ())]
    with found.collected():
        shapes.demand_few(math.prod(len(block) for block in blocks), tree)
        return [shapes.joined(chosen) for chosen in itertools.product(*blocks)]
    return []


def _listed(tree: LocatedValue, found: Findings) -> Iterator[list[Settings]]:
    """Yield the points of `grid`, `zip` and `points`."""
    for name, make in (("grid", shapes.grid), ("zip", shapes.zipped)):
        node = tree.child(name)
        if node is not None and node.value:
            yield _made(make, _axes(node, found), found)
    several = tree.child("points")
    if several is not None:
        with found.collected():
            if not several.value:
                raise InvalidAxis(several, "is an empty list: a sweep needs a point")
            yield [tuple(_axes(item, found).items()) for item in several.value]


def _sampled(tree: LocatedValue, written: SweepText, found: Findings) -> Iterator[list[Settings]]:
    """Yield the random points and those of a Latin hypercube."""
    for name, place in (("random", shapes.random), ("latin_hypercube", shapes.latin_hypercube)):
        drawn, over = getattr(written, name), tree.at((name, "over"))
        if drawn is not None and over is not None:
            with found.collected():
                if not over.value:
                    raise InvalidAxis(over, "is empty: name the axes of the random points")
                make = functools.partial(place, drawn.points, drawn.seed)
                yield _made(make, _axes(over, found), found)


def _made(make: Callable[[Axes], list[Settings]], axes: Axes, found: Findings) -> list[Settings]:
    """Return the points that a block makes of its axes. If it cannot, find out which axes are invalid: no point."""
    if not axes:
        return [()]
    before = len(found)
    try:
        return make(axes)
    except InvalidAxis as refused:
        for keys, node in axes.items():
            with found.collected():
                make({keys: node})
        if len(found) == before:  # each is valid by itself
            found.add([refused.within(found.tree)])
        return [()]


def _keys(key: str, entry: Entry) -> Keys:
    keys = keys_of(key)
    if not keys or keys[0] in ("extends", SCENARIO, *LEFT_OUT) or "=" in key:
        raise InvalidAxis(entry.node, f"'{key}' is not a key of a scenario that can be varied")
    return keys


def _axes(node: LocatedValue, found: Findings) -> dict[Keys, LocatedValue]:
    """Return the axes of a block, each by its path."""
    axes: dict[Keys, LocatedValue] = {}
    for keys, values in assignments_in(node, found):
        with found.collected():
            if keys in axes:
                raise InvalidAxis(values, f"'{dotted(keys)}' is an axis twice")
            axes[keys] = values
    return axes
