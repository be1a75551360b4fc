"""The axes of a sweep: what a file or `--vary` writes becomes points, each a set of values laid on a scenario.

    values_of(node, path) -> the values of one axis: a list, {range: [a, b], count: n}, {log_range: [a, b], count: n}
    grid(axes), zipped(axes), random(draw), latin_hypercube(draw) -> points, as tuples of (keys, Node)

Faults are raised as `InvalidAxis`, with the node that they stand at. Nothing is listed before it is counted.
"""

from __future__ import annotations

import itertools
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.errors import Issue
from wsnsim.scenario.fields import described
from wsnsim.scenario.located_values import Keys, LocatedValue, assigned, child, dotted, plain, sequence
from wsnsim.scenario.units import NUMBER, shown

Settings: TypeAlias = tuple[tuple[Keys, LocatedValue], ...]
"""What one point lays on the scenario."""
Axes: TypeAlias = Mapping[Keys, LocatedValue]
MOST_POINTS: Final = 20_000
LARGEST: Final = sys.float_info.max
RANGES: Final = ("range", "log_range")
SPACING: Final = ("count", "step")
WRITTEN: Final = re.compile(rf"({NUMBER})\s*(.*)", re.ASCII)


class InvalidAxis(Exception):
    """What is wrong with an axis, and the node at which it stands."""

    def __init__(self, node: LocatedValue, message: str) -> None:
        super().__init__(message)
        self.node = node

    def within(self, tree: LocatedValue) -> Issue:
        """The fault at its place, with the path under which it is written in the tree."""
        path = next((path for path, node in _walk(tree, ()) if node is self.node), ())
        return self.node.spot.issue(path, str(self))


class Span(NamedTuple):
    """Both ends of a range, the unit that both are written in, and how values between them are placed and written."""

    low: float
    high: float
    unit: str
    logarithmic: bool
    whole: bool

    def at(self, share: float) -> str | float | int:
        """The value at a share of the way from low to high, as a scenario would write it; both ends are exact."""
        value: float
        if share <= 0.0 or share >= 1.0:
            value = self.low if share <= 0.0 else self.high
        elif self.logarithmic:
            value = math.exp((1.0 - share) * math.log(self.low) + share * math.log(self.high))
        else:
            value = (1.0 - share) * self.low + share * self.high
        if self.whole:
            return round(value)
        short = float(min(max(float(f"{value:.12g}"), self.low), self.high)) if 0.0 < share < 1.0 else float(value)
        return f"{short!r} {self.unit}" if self.unit else short

    def drawn(self, uniform: float) -> str | float | int:
        """The value that a uniform number of [0, 1) falls on; whole numbers are equally likely, the ends as well."""
        if not self.whole:
            return self.at(uniform)
        low, high = self.low - 0.5, self.high + 0.5
        if self.logarithmic:
            value = math.exp((1.0 - uniform) * math.log(low) + uniform * math.log(high))
        else:
            value = (1.0 - uniform) * low + uniform * high
        return int(min(max(round(value), self.low), self.high))


class Sampling(NamedTuple):
    """Points to be drawn at random: how many, from which seed, over which axes."""

    points: int
    seed: int
    over: Axes


def values_of(node: LocatedValue, path: Keys) -> list[LocatedValue]:
    """The values of one axis, in order, each once.

    Raises:
        InvalidAxis: no list and no range, an empty list, a value twice, a range that cannot be.
    """
    if isinstance(node.value, list):
        if not node.value:
            raise InvalidAxis(node, "is an empty list: an axis needs a value")
        _refuse_twins(node.value)
        return list(node.value)
    if isinstance(node.value, dict) and any(name in node.value for name in RANGES):
        return _spaced(node)
    example = "[100, 200], {range: [0, 1], count: 5} or {log_range: [1, 100], count: 5}"
    raise InvalidAxis(node, f"expected values such as {example}, got {described(plain(node))}")


def of_reals(node: LocatedValue) -> LocatedValue:
    """The axis with the ends of its range as real numbers, so that the values between are not rounded."""
    changed = node
    for name in RANGES:
        ends = child(node, name)
        if ends is not None and isinstance(ends.value, list):
            changed = assigned(changed, (name,), sequence([_real(end) for end in ends.value], ends.spot))
    return changed


def count_of(node: LocatedValue) -> int:
    """How many values an axis has, before they are listed."""
    if isinstance(node.value, dict) and any(name in node.value for name in RANGES):
        return _count(node, _span(node))
    return len(node.value) if isinstance(node.value, list) else 1


def grid(axes: Axes) -> list[Settings]:
    """Every combination of the axes' values; the last axis varies fastest."""
    demand_few(math.prod(count_of(node) for node in axes.values()), next(iter(axes.values())))
    return [
        tuple(zip(axes, chosen, strict=True))
        for chosen in itertools.product(*(values_of(node, keys) for keys, node in axes.items()))
    ]


def zipped(axes: Axes) -> list[Settings]:
    """The axes' first values together, then their second, and so on.

    Raises:
        InvalidAxis: axes of unequal length, with the length of each.
    """
    columns = {keys: values_of(node, keys) for keys, node in axes.items()}
    if len({len(column) for column in columns.values()}) > 1:
        said = ", ".join(f"{dotted(keys)} has {len(column)}" for keys, column in columns.items())
        raise InvalidAxis(next(iter(axes.values())), f"axes that go together must be of one length: {said}")
    return [tuple(zip(axes, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def random(draw: Sampling) -> list[Settings]:
    """Independent points, uniform over the axes. The first points of a longer draw are those of a shorter one."""
    rng = np.random.Generator(np.random.Philox(draw.seed))
    return _placed(draw, rng.random((draw.points, len(draw.over))))


def latin_hypercube(draw: Sampling) -> list[Settings]:
    """A Latin hypercube: each axis cut in as many slices as there are points, one point in each slice.

    Source: McKay, Beckman, Conover (1979). Another number of points gives other points.
    """
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(len(draw.over), rng=np.random.Generator(np.random.Philox(draw.seed)))
    return _placed(draw, sampler.random(draw.points))


def demand_few(count: int, node: LocatedValue) -> None:
    """Refuse what nobody can wait for."""
    if count > MOST_POINTS:
        raise InvalidAxis(node, f"makes {_large(count)} points; at most {MOST_POINTS:,} are allowed")


def _large(count: int) -> str:
    return f"{count:,}" if count < 10**15 else f"{Decimal(count):.2e}"


def _placed(draw: Sampling, uniforms: np.ndarray) -> list[Settings]:
    """The points at shares of [0, 1) of each axis. Points that fall together (whole numbers) are kept once."""
    pickers = [_picker(node, keys) for keys, node in draw.over.items()]
    points: dict[str, Settings] = {}
    for row in uniforms.tolist():
        nodes = [pick(share) for pick, share in zip(pickers, row, strict=True)]
        points.setdefault(repr([plain(node) for node in nodes]), tuple(zip(draw.over, nodes, strict=True)))
    return list(points.values())


def _picker(node: LocatedValue, keys: Keys) -> Callable[[float], LocatedValue]:
    """How a uniform number becomes a value of the axis: one of a list, or a point of a range."""
    if isinstance(node.value, list):
        values = values_of(node, keys)
        return lambda share: values[min(int(share * len(values)), len(values) - 1)]
    if not (isinstance(node.value, dict) and any(name in node.value for name in RANGES)):
        values_of(node, keys)
    for name in SPACING:
        if name in node.value:
            raise InvalidAxis(node.value[name].node, f"'{name}' has no meaning where points are drawn")
    span = _span(node)
    return lambda share: LocatedValue(span.drawn(share), node.spot)


def _spaced(node: LocatedValue) -> list[LocatedValue]:
    span = _span(node)
    count = _count(node, span)
    demand_few(count, node)
    step = child(node, "step")
    if step is None:
        values = [span.at(i / (count - 1) if count > 1 else 0.0) for i in range(count)]
    else:
        width = span.high - span.low
        pace = _number(step, "a step")[0]
        values = [span.at(i * pace / width if width else 0.0) for i in range(count)]
    return [LocatedValue(value, node.spot) for value in dict.fromkeys(values)]


def _count(node: LocatedValue, span: Span) -> int:
    """How many values a range has: `count`, or as many as `step` fits in."""
    count, step = child(node, "count"), child(node, "step")
    if (count is None) == (step is None):
        raise InvalidAxis(node, "a range needs either 'count' (how many values) or 'step' (how far apart)")
    if count is not None:
        number = count.value
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:
            raise InvalidAxis(count, f"expected a whole number of at least 1, got {described(plain(count))}")
        return number
    assert step is not None
    if span.logarithmic:
        raise InvalidAxis(step, "a log_range takes 'count', not 'step'")
    pace, unit, _ = _number(step, "a step")
    if unit != span.unit or not pace > 0.0:
        raise InvalidAxis(step, f"a step must be positive, and in the unit of the range ('{span.unit or 'none'}')")
    steps = (float(span.high) - float(span.low)) / pace
    if not math.isfinite(steps):
        raise InvalidAxis(step, "is too small for a range that wide")
    return math.floor(steps * (1 + 1e-12) + 1e-9) + 1


def _span(node: LocatedValue) -> Span:
    name = next(name for name in RANGES if name in node.value)
    strange = [key for key in node.value if key not in (name, *SPACING)]
    if strange:
        raise InvalidAxis(node.value[strange[0]].node, f"unknown key {shown(strange[0])} in a range (count or step)")
    ends = node.value[name].node
    if not isinstance(ends.value, list) or len(ends.value) != 2:
        raise InvalidAxis(ends, f"expected [low, high], got {described(plain(ends))}")
    (low, unit, whole), (high, other, also) = (_number(end, "an end of a range") for end in ends.value)
    if unit != other:
        raise InvalidAxis(ends, f"both ends need one unit, not '{unit or 'none'}' and '{other or 'none'}'")
    logarithmic = name == "log_range"
    if not low <= high or (logarithmic and low <= 0.0):
        raise InvalidAxis(ends, f"needs low <= high{', both above 0' if logarithmic else ''}")
    paced = _number(node.value["step"].node, "a step")[2] if "step" in node.value else True
    return Span(low, high, unit, logarithmic, whole and also and paced)


def _number(node: LocatedValue, what: str) -> tuple[float, str, bool]:
    """A number, the unit it is written in, and whether it is written as a whole number without one."""
    value = node.value
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST:
        return value, "", isinstance(value, int)
    match = WRITTEN.fullmatch(value.strip()) if isinstance(value, str) else None
    number = float(match[1].replace(".inf", "inf")) if match else math.nan
    if match is None or not abs(number) <= LARGEST:
        raise InvalidAxis(node, f"{what} is a finite number, with a unit or without, not {described(plain(node))}")
    return number, match[2], False


def _real(end: LocatedValue) -> LocatedValue:
    whole = isinstance(end.value, int) and not isinstance(end.value, bool) and abs(end.value) <= LARGEST
    return LocatedValue(float(end.value), end.spot) if whole else end


def _walk(node: LocatedValue, path: Keys) -> Iterator[tuple[Keys, LocatedValue]]:
    yield path, node
    if isinstance(node.value, dict):
        for key, entry in node.value.items():
            yield from _walk(entry.node, (*path, key))
    elif isinstance(node.value, list):
        for i, item in enumerate(node.value):
            yield from _walk(item, (*path, i))


def _refuse_twins(nodes: Sequence[LocatedValue]) -> None:
    seen: dict[str, Any] = {}
    for node in nodes:
        text = repr(plain(node))
        if text in seen:
            raise InvalidAxis(node, f"{shown(plain(node))} stands in the list twice")
        seen[text] = node
