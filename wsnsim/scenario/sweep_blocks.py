"""The blocks of a sweep, and the findings of its validation, which are collected until nothing more can be checked.

found = Findings(tree)
combined(tree, written, found) -> the settings of every point, of the blocks that are valid
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, final

from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.scenario import axes as shapes
from wsnsim.scenario.axes import Axes, InvalidAxis, Sampling, Settings
from wsnsim.scenario.load import Assignment, ScenarioText, keys_of
from wsnsim.scenario.located_values import Entry, Keys, LocatedValue, assigned, at, child, dotted, in_order
from wsnsim.scenario.points import LEFT_OUT, SCENARIO, reals_of
from wsnsim.scenario.sweep_schema import SweepText

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
    is_real = reals_of(bases, common)
    for block in BLOCKS:
        axes = at(tree, block)
        for key, entry in axes.value.items() if axes is not None else ():
            if is_real(keys_of(key)):
                tree = assigned(tree, (*block, key), shapes.of_reals(entry.node))
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
        node = child(tree, name)
        if node is not None and node.value:
            yield _made(make, _axes(node, found), found)
    several = child(tree, "points")
    if several is not None:
        with found.collected():
            if not several.value:
                raise InvalidAxis(several, "is an empty list: a sweep needs a point")
            yield [tuple(_axes(item, found).items()) for item in several.value]


def _sampled(tree: LocatedValue, written: SweepText, found: Findings) -> Iterator[list[Settings]]:
    """Yield the random points and those of a Latin hypercube."""
    for name, place in (("random", shapes.random), ("latin_hypercube", shapes.latin_hypercube)):
        drawn, over = getattr(written, name), at(tree, (name, "over"))
        if drawn is not None and over is not None:
            with found.collected():
                if not over.value:
                    raise InvalidAxis(over, "is empty: name the axes of the random points")
                make = functools.partial(_placed, place, drawn.points, drawn.seed)
                yield _made(make, _axes(over, found), found)


def _placed(place: Callable[[Sampling], list[Settings]], points: int, seed: int, axes: Axes) -> list[Settings]:
    return place(Sampling(points, seed, axes))


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
