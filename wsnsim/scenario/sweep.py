"""Loading of sweeps: a scenario, axes and replicates become a list of checked points.

    plan = load_sweep("scenarios/sweeps/particles.yaml")           a file, or a shipped sweep's name
    plan = load_sweep("pso_mhpf", vary=["tracker.particles=100,200"])   a scenario, and axes from the command line

    name: particles
    scenario: ../pso_mhpf.yaml              # a file or a shipped name; several in a list are an axis of their own
    set: {link.reach: 80 m}                 # replaces values at every point
    grid: {tracker.particles: [100, 200], link.reach: {range: [60 m, 120 m], count: 4}}
    zip: {...}                              # axes varied together;  points: [{...}, ...] points one by one
    random: {points: 20, seed: 1, over: {sensor.decay: {range: [2, 3]}}}     # latin_hypercube: the same
    replicates: 30
    until: {metric: rmse, half_width: 5 %, at_least: 10, at_most: 200}

All blocks are combined with each other. A campaign records the tables `runs` and `tracks`; others are added as in
`set: {record.estimates: true}`.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import TABLES
from wsnsim.scenario import axes as shapes
from wsnsim.scenario.axes import InvalidAxis, Sampling, Settings
from wsnsim.scenario.files import content_of, find_or_none, find_sweep
from wsnsim.scenario.load import (
    Assignment,
    ScenarioText,
    assignments_of,
    keys_of,
    read_scenario,
)
from wsnsim.scenario.located_values import (
    Entry,
    Keys,
    LocatedValue,
    Origin,
    Spot,
    assigned,
    at,
    child,
    dotted,
    in_order,
    mapping,
    plain,
    sequence,
)
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.points import LEFT_OUT, SCENARIO, demand_no_axis, keys_of_points, points_of, reals_of
from wsnsim.scenario.reader import of_dict, origin_of, read
from wsnsim.scenario.sweep_schema import Plan, SweepText
from wsnsim.scenario.tracker_choices import tracker_choices, with_trackers

KEPT: Final = ("runs", "tracks")
"""The tables that a campaign records by default."""
BLOCKS: Final = (("grid",), ("zip",), ("random", "over"), ("latin_hypercube", "over"))
"""The blocks of a sweep that hold axes."""
SIGNS: Final = ("scenario", "points", *(block[0] for block in BLOCKS))
"""Keys of a sweep that no scenario has."""
MOST_RUNS: Final = 2_000_000
"""The limit of points times replicates."""


def is_sweep(source: str | Path) -> bool:
    """Return whether a name refers to a sweep (a file or shipped) rather than to a scenario.

    A file that cannot be read counts as a sweep, so that `load_sweep` reports what is wrong with it.
    """
    path = find_sweep(source)
    if path is None:
        return False
    content = content_of(path)[0]
    tree = read(content, Origin(str(path), Path()))[0] if content is not None else None
    return tree is None or (isinstance(tree.value, dict) and any(sign in tree.value for sign in SIGNS))


def load_sweep(
    source: str | Path | Mapping[str, Any] | Sequence[str],
    vary: Iterable[str] = (),
    overrides: Iterable[str] = (),
    trackers: str | None = None,
    **given: Any,
) -> Plan:
    """Return the plan of a sweep.

    A range between whole numbers holds whole numbers only, unless the scenario has a real number at its key.

    Args:
        source: a file, a dict with the same keys, or the names of one or several scenarios.
        vary: further axes of the grid, such as 'tracker.particles=100,200'.
        overrides: assignments as those of `--set`.
        trackers: trackers to run at every point, each with its own parameters, such as 'pf:particles=1000,ekf'.
        given: values that replace `name`, `replicates` and `timeout` of the sweep.

    Raises:
        ScenarioError: with the issues of the sweep, or of its points.
    """
    tree, name, text = _read(source)
    tree = _with_given(_with_vary(tree, vary), given, name)
    try:
        written = SweepText.model_validate(plain(tree))
    except ValidationError as error:
        raise ScenarioError(issues_of(error, SweepText, tree)) from None
    assignments, wrong = assignments_of(overrides)
    if wrong:
        raise ScenarioError(wrong)
    bases = _bases(tree)
    try:
        common = [*_record(tree.spot), *_assigned(child(tree, "set")), *assignments]
        tree = _with_reals(tree, bases, common)
        settings, names = with_trackers(tracker_choices(trackers) if trackers else [], _combined(tree, written))
        shapes.demand_few(len(bases) * len(settings), tree)
    except InvalidAxis as refused:
        raise ScenarioError([refused.within(tree)]) from None
    demand_no_axis(assignments, settings)
    points = points_of(bases, common, settings, names)
    most = written.until.at_most if written.until else written.replicates
    if most is None:
        most = max(json.loads(point.resolved)["replicates"] for point in points)
    _demand_few_runs(tree, len(points) * most)
    return Plan(
        name=written.name or name,
        keys=keys_of_points(points),
        points=tuple(points),
        replicates=most,
        until=written.until,
        block=written.block,
        timeout=written.timeout,
        source=text,
    )


def _bases(tree: LocatedValue) -> list[ScenarioText]:
    """Return the scenarios that the sweep names: files of its folder, or shipped ones."""
    node = tree.value["scenario"].node
    if node.value == []:
        raise ScenarioError([node.spot.issue(("scenario",), "is an empty list: a sweep needs a scenario")])
    found = []
    for item in node.value if isinstance(node.value, list) else [node]:
        path = find_or_none(item.value, item.spot.origin.folder)
        text = read_scenario(path or item.value)
        if text.tree is None:
            place = item.spot.origin.lines and path is None
            raise ScenarioError(
                [item.spot.issue(("scenario",), issue.message) for issue in text.issues] if place else text.issues
            )
        found.append(text)
    return found


def _read(source: str | Path | Mapping[str, Any] | Sequence[str]) -> tuple[LocatedValue, str, str]:
    """Return (tree, default name of the sweep, text)."""
    if isinstance(source, Mapping):
        tree, issues = of_dict(source, Origin("", Path.cwd()))
        if issues:
            raise ScenarioError(in_order(issues))
        return tree, "sweep", json.dumps(plain(tree), indent=1, default=str)
    if isinstance(source, str | Path) and is_sweep(source):
        path = find_sweep(source)
        assert path is not None
        content, issues = content_of(path)
        node, found = (None, issues) if content is None else read(content, origin_of(path, content))
        if node is None or found:
            raise ScenarioError(in_order(found))
        return node, path.stem, content or ""
    names = [str(source)] if isinstance(source, str | Path) else [str(name) for name in source]
    spot = Spot(Origin("", Path.cwd()))
    nodes = [LocatedValue(name, spot) for name in names]
    given = nodes[0] if len(nodes) == 1 else sequence(nodes, spot)
    stems = "_".join(Path(name).stem for name in names[:4])
    return mapping({"scenario": Entry(spot, given)}, spot), re.sub(r"^\W|[^\w.\-]", "_", stems)[:100] or "sweep", ""


def _with_vary(tree: LocatedValue, vary: Iterable[str]) -> LocatedValue:
    """Return the tree with the axes of the command line in its grid; they replace axes of the same key."""
    added: dict[str, Entry] = {}
    for text in vary:
        key, sign, values = text.partition("=")
        keys = keys_of(key)
        spot = Spot(Origin(f"--vary {key.strip()}".strip(), Path.cwd(), (), keys))
        if not sign or not keys or not values.strip():
            example = "--vary tracker.particles=100,200 or --vary 'link.reach={range: [60 m, 80 m], count: 3}'"
            raise ScenarioError([spot.issue(keys, f"expected KEY=VALUES, such as {example}")])
        if dotted(keys) in added:
            raise ScenarioError([spot.issue(keys, "is given twice: write all of its values in one --vary")])
        node, issues = read(f"[{values}]", spot.origin)
        if node is None or issues:
            raise ScenarioError(issues)
        alone = node.value[0] if len(node.value) == 1 else None
        is_range = alone is not None and isinstance(alone.value, dict) and any(n in alone.value for n in shapes.RANGES)
        added[dotted(keys)] = Entry(spot, alone if is_range and alone is not None else node)
    if not added:
        return tree
    old = child(tree, "grid")
    grid = mapping({**(old.value if old and isinstance(old.value, dict) else {}), **added}, tree.spot)
    return mapping({**tree.value, "grid": Entry(tree.spot, grid)}, tree.spot)


def _with_given(tree: LocatedValue, given: Mapping[str, Any], name: str) -> LocatedValue:
    """Return the tree with the values of the command line; --replicates also removes a stopping rule."""
    default = {"name": Entry(tree.spot, LocatedValue(name, tree.spot))}
    spots = {key: Spot(Origin(f"--{key}", Path.cwd(), (), (key,))) for key in given}
    replacements = {
        key: Entry(spots[key], LocatedValue(value, spots[key])) for key, value in given.items() if value is not None
    }
    kept = {key: entry for key, entry in tree.value.items() if not ("replicates" in replacements and key == "until")}
    return mapping({**default, **kept, **replacements}, tree.spot)


def _record(spot: Spot) -> list[Assignment]:
    return [(("record", table), LocatedValue(table in KEPT, spot)) for table in TABLES]


def _assigned(node: LocatedValue | None) -> list[Assignment]:
    """Return the assignments of a mapping of dotted keys."""
    if node is None:
        return []
    return [(_keys(key, entry), entry.node) for key, entry in node.value.items()]


def _keys(key: str, entry: Entry) -> Keys:
    keys = keys_of(key)
    if not keys or keys[0] in ("extends", SCENARIO, *LEFT_OUT) or "=" in key:
        raise InvalidAxis(entry.node, f"'{key}' is not a key of a scenario that can be varied")
    return keys


def _axes(node: LocatedValue) -> shapes.Axes:
    """Return the axes of a block, each by its path."""
    axes: dict[Keys, LocatedValue] = {}
    for keys, values in _assigned(node):
        if keys in axes:
            raise InvalidAxis(values, f"'{dotted(keys)}' is an axis twice")
        axes[keys] = values
    return axes


def _with_reals(tree: LocatedValue, bases: Iterable[ScenarioText], common: Sequence[Assignment]) -> LocatedValue:
    """Return the tree with ranges of real numbers wherever the scenarios have a real number at the key."""
    is_real = reals_of(bases, common)
    for block in BLOCKS:
        axes = at(tree, block)
        for key, entry in axes.value.items() if axes is not None else ():
            if is_real(keys_of(key)):
                tree = assigned(tree, (*block, key), shapes.of_reals(entry.node))
    return tree


def _combined(tree: LocatedValue, written: SweepText) -> list[Settings]:
    """Return the settings of every point: all combinations of the blocks."""
    blocks: list[list[Settings]] = []
    for name in ("grid", "zip"):
        node = child(tree, name)
        if node is not None and node.value:
            blocks.append(getattr(shapes, "grid" if name == "grid" else "zipped")(_axes(node)))
    several = child(tree, "points")
    if several is not None:
        if not several.value:
            raise InvalidAxis(several, "is an empty list: a sweep needs a point")
        blocks.append([tuple(_axes(item).items()) for item in several.value])
    for name, place in (("random", shapes.random), ("latin_hypercube", shapes.latin_hypercube)):
        drawn, over = getattr(written, name), at(tree, (name, "over"))
        if drawn is not None and over is not None:
            if not over.value:
                raise InvalidAxis(over, "is empty: name the axes of the random points")
            blocks.append(place(Sampling(drawn.points, drawn.seed, _axes(over))))
    shapes.demand_few(math.prod(len(block) for block in blocks), tree)
    return [shapes.joined(chosen) for chosen in itertools.product(*blocks)]


def _demand_few_runs(tree: LocatedValue, runs: int) -> None:
    if runs > MOST_RUNS:
        raise ScenarioError([tree.spot.issue((), f"makes {runs:,} runs; at most {MOST_RUNS:,} are allowed")])
