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

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from wsnsim.base.errors import ScenarioError, dotted
from wsnsim.base.tables import TABLES
from wsnsim.scenario import axes as shapes
from wsnsim.scenario.axes import demand_few
from wsnsim.scenario.build import resolved
from wsnsim.scenario.load import Overrides, assignments_of, keys_of
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.points import (
    BLOCKS,
    Findings,
    PointName,
    assignments_in,
    combined,
    demand_no_axis,
    points_of,
    with_reals,
)
from wsnsim.scenario.python_values import of_dict
from wsnsim.scenario.reader import origin_of, read, read_scenario
from wsnsim.scenario.schema import Scenario
from wsnsim.scenario.sweep_schema import Plan, SweepText
from wsnsim.scenario.texts import (
    Assignment,
    Entry,
    LocatedValue,
    Origin,
    ScenarioText,
    Spot,
    content_of,
    find_or_none,
    find_sweep,
    in_order,
)
from wsnsim.scenario.tracker_choices import choices_of, with_trackers

KEPT: Final = ("runs", "tracks")
"""The tables that a campaign records by default."""
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
    source: Any,
    vary: Iterable[str] | Mapping[str, Any] = (),
    overrides: Overrides = (),
    trackers: str | Sequence[Any] | Mapping[str, Any] | None = None,
    **given: Any,
) -> Plan:
    """Return the plan of a sweep.

    A range between whole numbers holds whole numbers only, unless the scenario has a real number at its key.

    Args:
        source: a file, a dict with the same keys, the names of one or several scenarios, a scenario as a dict, or what
            `load` returned.
        vary: further axes of the grid, such as ['tracker.particles=100,200'] or {'tracker.particles': [100, 200]}.
        overrides: assignments as those of `--set`, as a list or as a mapping.
        trackers: trackers to run at every point, each with its own parameters, such as 'pf:particles=1000,ekf', or
            components, mappings and names in a list.
        given: values that replace `name`, `replicates` and `timeout` of the sweep.

    Raises:
        ScenarioError: with the issues of the sweep, or of its points.
    """
    own = _own_scenario(source)
    tree, name, text = _read(source) if own is None else _of_own(own)
    found = Findings(_with_given(_with_vary(tree, vary), given, name))
    written = _checked(found)
    tree = found.tree
    assignments, wrong = assignments_of(overrides)
    found.add(wrong)
    bases = _bases(tree, found) if own is None else [own]
    recorded = [(("record", table), LocatedValue(table in KEPT, tree.spot)) for table in TABLES]
    common: list[Assignment] = [*recorded, *assignments_in(tree.child("set"), found), *assignments]
    found.tree = tree = with_reals(tree, bases, common)
    settings = combined(tree, written, found)
    names: list[PointName] | None = None
    with found.collected():
        settings, names = with_trackers(choices_of(trackers or ()), settings)
        demand_few(len(bases) * len(settings), tree)
        demand_no_axis(assignments, settings)
        points = points_of(bases, common, settings, names)
    found.demand_none()
    assert written is not None, "a sweep without findings is valid"
    most = written.until.at_most if written.until else written.replicates
    if most is None:
        most = max(json.loads(point.resolved)["replicates"] for point in points)
    if (runs := len(points) * most) > MOST_RUNS:
        raise ScenarioError([tree.spot.issue((), f"makes {runs:,} runs; at most {MOST_RUNS:,} are allowed")])
    return Plan(
        name=written.name or name,
        keys=tuple(dict.fromkeys(key for point in points for key in point.settings)),
        points=tuple(points),
        replicates=most,
        until=written.until,
        block=written.block,
        timeout=written.timeout,
        source=text,
    )


def _own_scenario(source: Any) -> ScenarioText | None:
    """Return the text of a scenario that the caller wrote as a dict, or loaded; None for anything else.

    Raises:
        ScenarioError: with its issues.
    """
    values = resolved(source) if isinstance(source, Scenario) else source
    if not isinstance(values, Mapping) or any(sign in values for sign in SIGNS):
        return None
    text = read_scenario(values)
    if text.issues or text.tree is None:
        raise ScenarioError(in_order(text.issues))
    return text


def _of_own(own: ScenarioText) -> tuple[LocatedValue, str, str]:
    """Return what `_read` returns, for a scenario of the caller, which is named instead of a file."""
    assert own.tree is not None
    named = own.tree.child("name")
    name = named.value if named is not None and isinstance(named.value, str) else "sweep"
    spot = Spot(Origin("", Path.cwd()))
    return LocatedValue({"scenario": Entry(spot, LocatedValue(name, spot))}, spot), name, own.origin[1]


def _checked(found: Findings) -> SweepText | None:
    """Return the checked keys of a sweep. Keys that are invalid are left out of `found.tree`; None if others need them.

    What depends on a key that is left out cannot be checked; the rest can.
    """
    tree = found.tree
    try:
        return SweepText.model_validate(tree.plain())
    except ValidationError as error:
        issues = issues_of(error, SweepText, tree)
    found.add(issues)
    wrong = {issue.path[0] for issue in issues if issue.path}
    found.tree = LocatedValue({key: entry for key, entry in tree.value.items() if key not in wrong}, tree.spot)
    try:
        return SweepText.model_validate(found.tree.plain())
    except ValidationError:
        return None


def _bases(tree: LocatedValue, found: Findings) -> list[ScenarioText]:
    """Return the scenarios that the sweep names and that can be read: files of its folder, or shipped ones."""
    node = tree.child("scenario")
    if node is None:
        return []
    if node.value == []:
        found.add([node.spot.issue(("scenario",), "is an empty list: a sweep needs a scenario")])
    bases = []
    for item in node.value if isinstance(node.value, list) else [node]:
        path = find_or_none(item.value, item.spot.origin.folder)
        text = read_scenario(path or item.value)
        if text.tree is not None:
            bases.append(text)
        elif item.spot.origin.lines and path is None:
            found.add(item.spot.issue(("scenario",), issue.message) for issue in text.issues)
        else:
            found.add(text.issues)
    return bases


def _read(source: str | Path | Mapping[str, Any] | Sequence[str]) -> tuple[LocatedValue, str, str]:
    """Return (tree, default name of the sweep, text)."""
    if isinstance(source, Mapping):
        tree, issues = of_dict(source, Origin("", Path.cwd()))
        if issues:
            raise ScenarioError(in_order(issues))
        return tree, "sweep", json.dumps(tree.plain(), indent=1, default=str)
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
    given = nodes[0] if len(nodes) == 1 else LocatedValue(nodes, spot)
    stems = "_".join(Path(name).stem for name in names[:4])
    return (
        LocatedValue({"scenario": Entry(spot, given)}, spot),
        re.sub(r"^\W|[^\w.\-]", "_", stems)[:100] or "sweep",
        "",
    )


def _with_vary(tree: LocatedValue, vary: Iterable[str] | Mapping[str, Any]) -> LocatedValue:
    """Return the tree with the axes of the command line in its grid; they replace axes of the same key."""
    if isinstance(vary, Mapping):
        given, issues = of_dict(vary, Origin("", Path.cwd()), ("grid",))
        if issues:
            raise ScenarioError(in_order(issues))
        return _with_axes(tree, given.value) if vary else tree
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
    return _with_axes(tree, added)


def _with_axes(tree: LocatedValue, added: Mapping[str, Entry]) -> LocatedValue:
    """Return the tree with axes in its grid; they replace axes of the same key."""
    old = tree.child("grid")
    grid = LocatedValue({**(old.value if old and isinstance(old.value, dict) else {}), **added}, tree.spot)
    return LocatedValue({**tree.value, "grid": Entry(tree.spot, grid)}, tree.spot)


def _with_given(tree: LocatedValue, given: Mapping[str, Any], name: str) -> LocatedValue:
    """Return the tree with the values of the command line; --replicates also removes a stopping rule."""
    default = {"name": Entry(tree.spot, LocatedValue(name, tree.spot))}
    spots = {key: Spot(Origin(f"--{key}", Path.cwd(), (), (key,))) for key in given}
    replacements = {
        key: Entry(spots[key], LocatedValue(value, spots[key])) for key, value in given.items() if value is not None
    }
    kept = {key: entry for key, entry in tree.value.items() if not ("replicates" in replacements and key == "until")}
    return LocatedValue({**default, **kept, **replacements}, tree.spot)
