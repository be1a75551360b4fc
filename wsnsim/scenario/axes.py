"""The axes of a sweep: from a file or `--vary` to points, each a set of values assigned to a scenario.

    values_of(node) -> the values of one axis: a list, {range: [a, b], count: n}, {log_range: [a, b], count: n}
    grid(axes), zipped(axes), random(points, seed, axes), latin_hypercube(points, seed, axes)
    -> points, as tuples of (keys, LocatedValue)

Issues are raised as `InvalidAxis`, with the value that causes them. Points are counted before they are listed.
"""

from __future__ import annotations

import itertools
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.errors import Issue, dotted
from wsnsim.scenario.texts import Keys, LocatedValue
from wsnsim.scenario.units import NUMBER, described, shown

Settings: TypeAlias = tuple[tuple[Keys, LocatedValue], ...]
"""The assignments of one point."""
Axes: TypeAlias = Mapping[Keys, LocatedValue]
MOST_POINTS: Final = 20_000
LARGEST: Final = sys.float_info.max
RANGES: Final = ("range", "log_range")
SPACING: Final = ("count", "step")
WRITTEN: Final = re.compile(rf"({NUMBER})\s*+(.*)", re.ASCII)


class InvalidAxis(Exception):
    """An axis is invalid. `node`: the value that causes it."""

    def __init__(self, node: LocatedValue, message: str) -> None:
        super().__init__(message)
        self.node = node

    def within(self, tree: LocatedValue) -> Issue:
        """Return the issue at its position, with its path in the tree."""
        path = next((path for path, node in _walk(tree, ()) if node is self.node), ())
        return self.node.spot.issue(path, str(self))


class Span(NamedTuple):
    """The ends of a range with their unit, and the rule by which values between them are placed and written."""

    low: float
    high: float
    unit: str
    logarithmic: bool
    whole: bool

    def at(self, share: float) -> str | float | int:
        """Return the value at a fraction of the way from low to high, as a scenario writes it; the ends are exact."""
        value: float
        if share <= 0.0 or share >= 1.0:
            value = self.low if share <= 0.0 else self.high
        else:
            value = self._between(self.low, self.high, share)
        if self.whole:
            return round(value)
        short = float(min(max(float(f"{value:.12g}"), self.low), self.high)) if 0.0 < share < 1.0 else float(value)
        return f"{short!r} {self.unit}" if self.unit else short

    def sample(self, uniform: float) -> str | float | int:
        """Return the value of a uniform number in [0, 1); all whole numbers are equally likely, the ends included."""
        if not self.whole:
            return self.at(uniform)
        value = self._between(self.low - 0.5, self.high + 0.5, uniform)
        return int(min(max(round(value), self.low), self.high))

    def _between(self, low: float, high: float, share: float) -> float:
        if self.logarithmic:
            return math.exp((1.0 - share) * math.log(low) + share * math.log(high))
        return (1.0 - share) * low + share * high


def values_of(node: LocatedValue) -> list[LocatedValue]:
    """Return the values of one axis, in order, each once.

    Raises:
        InvalidAxis: neither a list nor a range, an empty list, a value twice, or an invalid range.
    """
    if isinstance(node.value, list):
        if not node.value:
            raise InvalidAxis(node, "is an empty list: an axis needs a value")
        _refuse_twins(node.value)
        return list(node.value)
    if isinstance(node.value, dict) and any(name in node.value for name in RANGES):
        return _spaced(node)
    example = "[100, 200], {range: [0, 1], count: 5} or {log_range: [1, 100], count: 5}"
    raise InvalidAxis(node, f"expected values such as {example}, got {described(node.plain())}")


def of_reals(node: LocatedValue) -> LocatedValue:
    """Return the axis with real numbers as ends of its range, so that the values between are not rounded."""
    changed = node
    for name in RANGES:
        ends = node.child(name)
        if ends is not None and isinstance(ends.value, list):
            changed = changed.assigned((name,), LocatedValue([_real(end) for end in ends.value], ends.spot))
    return changed


def count_of(node: LocatedValue) -> int:
    """Return the number of values of an axis, without listing them."""
    if isinstance(node.value, dict) and any(name in node.value for name in RANGES):
        return _count(node, _span(node))
    return len(node.value) if isinstance(node.value, list) else 1


def grid(axes: Axes) -> list[Settings]:
    """Return every combination of the axes' values; the last axis varies fastest."""
    demand_few(math.prod(count_of(node) for node in axes.values()), next(iter(axes.values())))
    return [tuple(zip(axes, chosen, strict=True)) for chosen in itertools.product(*map(values_of, axes.values()))]


def zipped(axes: Axes) -> list[Settings]:
    """Return the first values of all axes as one point, the second values as the next, and so on.

    Raises:
        InvalidAxis: the axes have unequal lengths.
    """
    columns = {keys: values_of(node) for keys, node in axes.items()}
    if len({len(column) for column in columns.values()}) > 1:
        counts = ", ".join(f"{dotted(keys)} has {len(column)}" for keys, column in columns.items())
        raise InvalidAxis(next(iter(axes.values())), f"axes of `zip` must have equal lengths: {counts}")
    return [tuple(zip(axes, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def random(points: int, seed: int, over: Axes) -> list[Settings]:
    """Return independent points, uniform over the axes. A longer sample begins with the points of a shorter one."""
    return _placed(over, np.random.Generator(np.random.Philox(seed)).random((points, len(over))))


def latin_hypercube(points: int, seed: int, over: Axes) -> list[Settings]:
    """Return a Latin hypercube sample: each axis is cut into as many intervals as points, with one point in each.

    Another number of points gives other points. Source: McKay, Beckman, Conover (1979).
    """
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(len(over), rng=np.random.Generator(np.random.Philox(seed)))
    return _placed(over, sampler.random(points))


def demand_few(count: int, node: LocatedValue) -> None:
    """Refuse more points than MOST_POINTS."""
    if count > MOST_POINTS:
        large = f"{count:,}" if count < 10**15 else f"{Decimal(count):.2e}"
        raise InvalidAxis(node, f"makes {large} points; at most {MOST_POINTS:,} are allowed")


def _placed(over: Axes, uniforms: np.ndarray) -> list[Settings]:
    """Return the points at fractions in [0, 1) of each axis. Equal points (of whole numbers) are kept once."""
    pickers = list(map(_picker, over.values()))
    points: dict[str, Settings] = {}
    for row in uniforms.tolist():
        nodes = [pick(share) for pick, share in zip(pickers, row, strict=True)]
        points.setdefault(repr([node.plain() for node in nodes]), tuple(zip(over, nodes, strict=True)))
    return list(points.values())


def _picker(node: LocatedValue) -> Callable[[float], LocatedValue]:
    """Return the function from a uniform number to a value of the axis: an item of a list, or a point of a range."""
    if isinstance(node.value, list):
        values = values_of(node)
        return lambda share: values[min(int(share * len(values)), len(values) - 1)]
    if not (isinstance(node.value, dict) and any(name in node.value for name in RANGES)):
        values_of(node)
    for name in SPACING:
        if name in node.value:
            raise InvalidAxis(node.value[name].node, f"'{name}' is not allowed for random points")
    span = _span(node)
    return lambda share: LocatedValue(span.sample(share), node.spot)


def _spaced(node: LocatedValue) -> list[LocatedValue]:
    span = _span(node)
    count = _count(node, span)
    demand_few(count, node)
    step = node.child("step")
    if step is None:
        values = [span.at(i / (count - 1) if count > 1 else 0.0) for i in range(count)]
    else:
        width = span.high - span.low
        pace = _number(step, "a step")[0]
        values = [span.at(i * pace / width if width else 0.0) for i in range(count)]
    return [LocatedValue(value, node.spot) for value in dict.fromkeys(values)]


def _count(node: LocatedValue, span: Span) -> int:
    """Return the number of values of a range: `count`, or what `step` gives."""
    count, step = node.child("count"), node.child("step")
    if (count is None) == (step is None):
        raise InvalidAxis(node, "a range needs either 'count' (number of values) or 'step' (distance between them)")
    if count is not None:
        number = count.value
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:
            raise InvalidAxis(count, f"expected a whole number of at least 1, got {described(count.plain())}")
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
        raise InvalidAxis(ends, f"expected [low, high], got {described(ends.plain())}")
    (low, unit, whole), (high, other, also) = (_number(end, "an end of a range") for end in ends.value)
    if unit != other:
        raise InvalidAxis(ends, f"both ends need one unit, not '{unit or 'none'}' and '{other or 'none'}'")
    logarithmic = name == "log_range"
    if not low <= high or (logarithmic and low <= 0.0):
        raise InvalidAxis(ends, f"needs low <= high{', both above 0' if logarithmic else ''}")
    paced = _number(node.value["step"].node, "a step")[2] if "step" in node.value else True
    return Span(low, high, unit, logarithmic, whole and also and paced)


def _number(node: LocatedValue, what: str) -> tuple[float, str, bool]:
    """Return a number, its unit as written, and whether it is a whole number without unit."""
    value = node.value
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST:
        return value, "", isinstance(value, int)
    match = WRITTEN.fullmatch(value.strip()) if isinstance(value, str) else None
    number = float(match[1].replace(".inf", "inf")) if match else math.nan
    if match is None or not abs(number) <= LARGEST:
        raise InvalidAxis(node, f"{what} is a finite number, with a unit or without, not {described(node.plain())}")
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
        text = repr(node.plain())
        if text in seen:
            raise InvalidAxis(node, f"{shown(node.plain())} is in the list twice")
        seen[text] = node


def joined(chosen: Iterable[Settings]) -> Settings:
    """Return several settings as one. Raises InvalidAxis if two of them have the same key."""
    together = tuple(itertools.chain.from_iterable(chosen))
    seen: set[Keys] = set()
    for keys, node in together:
        if keys in seen:
            raise InvalidAxis(node, f"'{dotted(keys)}' is an axis twice")
        seen.add(keys)
    return together
