"""The axes of a sweep: which values a list, a range or a draw stands for, and which are refused."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.helpers.calls import counted_calls
from wsnsim.scenario import axes
from wsnsim.scenario.axes import InvalidAxis
from wsnsim.scenario.python_values import of_dict
from wsnsim.scenario.texts import LocatedValue, Origin
from wsnsim.scenario.units import si

KEYS = ("tracker", "particles")
WHOLE = st.integers(-(10**6), 10**6)
REAL = st.floats(-1e9, 1e9, allow_nan=False)


def node_of(value: Any) -> LocatedValue:
    tree, faults = of_dict({"axis": value}, Origin("", Path()))
    assert not faults
    return tree.value["axis"].node


def axes_of(values: dict[str, Any]) -> dict[tuple[str, ...], LocatedValue]:
    return {tuple(key.split(".")): node_of(value) for key, value in values.items()}


def values(value: Any) -> list[Any]:
    return [node.plain() for node in axes.values_of(node_of(value))]


def points(settings: list[axes.Settings]) -> list[tuple[Any, ...]]:
    return [tuple(node.plain() for _, node in laid) for laid in settings]


def drawn(
    how: Callable[[int, int, axes.Axes], list[axes.Settings]], count: int, seed: int = 0, **over: Any
) -> list[tuple[Any, ...]]:
    return points(how(count, seed, axes_of(over)))


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ([3, 1, 2], [3, 1, 2]),
        (["pso_mhpf", "ipf"], ["pso_mhpf", "ipf"]),
        ([[1, 2], [3, 4]], [[1, 2], [3, 4]]),
        ([{"kind": "ipf"}, {"kind": "sir"}], [{"kind": "ipf"}, {"kind": "sir"}]),
        ([True, False], [True, False]),
        ([None, 1], [None, 1]),
        ({"range": [0.0, 1.0], "count": 5}, [0.0, 0.25, 0.5, 0.75, 1.0]),
        ({"range": [0.0, 1.0], "count": 1}, [0.0]),
        ({"range": [0.1, 0.5], "step": 0.1}, [0.1, 0.2, 0.3, 0.4, 0.5]),
        ({"range": [0.0, 1.0], "step": 0.3}, [0.0, 0.3, 0.6, 0.9]),
        ({"range": [0.0, 1.0], "step": 2.0}, [0.0]),
        ({"range": [2.5, 2.5], "count": 4}, [2.5]),
        ({"range": [2.5, 2.5], "step": 1.0}, [2.5]),
        ({"range": [-1.0, 1.0], "count": 3}, [-1.0, 0.0, 1.0]),
        ({"range": ["60 m", "120 m"], "count": 3}, ["60.0 m", "90.0 m", "120.0 m"]),
        ({"range": ["60m", "120  m"], "step": "20 m"}, ["60.0 m", "80.0 m", "100.0 m", "120.0 m"]),
        ({"range": ["0 %", "50 %"], "count": 3}, ["0.0 %", "25.0 %", "50.0 %"]),
        ({"range": ["-90 dBm", "-80 dBm"], "step": "5 dBm"}, ["-90.0 dBm", "-85.0 dBm", "-80.0 dBm"]),
        ({"log_range": ["1 mJ", "100 mJ"], "count": 3}, ["1.0 mJ", "10.0 mJ", "100.0 mJ"]),
        ({"log_range": [0.01, 100.0], "count": 5}, [0.01, 0.1, 1.0, 10.0, 100.0]),
        ({"range": [100, 400], "count": 4}, [100, 200, 300, 400]),
        ({"range": [1, 10], "step": 3}, [1, 4, 7, 10]),
        ({"range": [1, 10], "step": 4}, [1, 5, 9]),
        ({"range": [0, 1], "step": 0.5}, [0.0, 0.5, 1.0]),
        ({"range": [0, 1.0], "count": 3}, [0.0, 0.5, 1.0]),
        ({"range": [1, 3], "count": 9}, [1, 2, 3]),
        ({"log_range": [25, 1600], "count": 7}, [25, 50, 100, 200, 400, 800, 1600]),
        ({"log_range": [1, 4], "count": 30}, [1, 2, 3, 4]),
        ({"range": [2**60, 2**60 + 1], "count": 2}, [2**60, 2**60 + 1]),
    ],
)  # fmt: skip
def test_an_axis_is_its_values_in_order_each_once(written: Any, expected: list[Any]) -> None:
    found = values(written)
    assert found == expected
    assert [type(value) for value in found] == [type(value) for value in expected]
    assert axes.count_of(node_of(written)) >= len(found)


@given(REAL, REAL, st.integers(2, 40))
def test_both_ends_of_a_range_are_exactly_as_written(one: float, other: float, count: int) -> None:
    low, high = sorted((one, other))
    found = values({"range": [low, high], "count": count})
    assert (found[0], found[-1]) == (low, high)
    assert found == sorted(found)


@given(st.floats(1e-9, 1e9), st.floats(1e-9, 1e9), st.integers(2, 40))
def test_a_log_range_has_exact_ends_and_equal_ratios(one: float, other: float, count: int) -> None:
    low, high = sorted((one, other))
    found = values({"log_range": [low, high], "count": count})
    assert (found[0], found[-1]) == (low, high)
    if len(found) == count and high > low:
        ratios = [math.log(b / a) for a, b in itertools.pairwise(found)]
        assert ratios == pytest.approx([math.log(high / low) / (count - 1)] * (count - 1), abs=1e-10)


@given(WHOLE, st.integers(0, 300), st.integers(1, 50))
def test_whole_numbers_by_a_step_are_those_of_pythons_range(low: int, width: int, step: int) -> None:
    assert values({"range": [low, low + width], "step": step}) == list(range(low, low + width + 1, step))


@given(st.floats(0.001, 1e6), st.floats(0.0, 1e6), st.integers(2, 20))
def test_a_unit_changes_how_values_are_written_and_not_what_they_are(low: float, width: float, count: int) -> None:
    bare = values({"range": [low, low + width], "count": count})
    written = values({"range": [f"{low!r} km", f"{low + width!r} km"], "count": count})
    assert [si(value, "m") for value in written] == [si(f"{value!r} km", "m") for value in bare]


def test_a_grid_is_the_product_of_its_axes_and_the_last_varies_fastest() -> None:
    found = axes.grid(axes_of({"a.b": [1, 2], "c": {"range": [0.0, 1.0], "count": 2}, "d": ["x", "y", "z"]}))
    assert points(found) == list(itertools.product([1, 2], [0.0, 1.0], ["x", "y", "z"]))
    assert {tuple(keys for keys, _ in laid) for laid in found} == {(("a", "b"), ("c",), ("d",))}


def test_zipped_axes_go_together() -> None:
    found = axes.zipped(axes_of({"a": [1, 2, 3], "b": {"range": ["1 m", "3 m"], "count": 3}, "c": [[1], [2], [3]]}))
    assert points(found) == [(1, "1.0 m", [1]), (2, "2.0 m", [2]), (3, "3.0 m", [3])]


def test_zipped_axes_are_compared_by_how_many_values_they_have_and_not_by_what_they_count() -> None:
    assert points(axes.zipped(axes_of({"a": {"range": [1, 3], "count": 5}, "b": [7, 8, 9]}))) == [
        (1, 7), (2, 8), (3, 9),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ([], "is an empty list: an axis needs a value"),
        ([1, 2, 1], "1 is in the list twice"),
        (["60 m", "60 m"], "'60 m' is in the list twice"),
        (3, "expected values such as .*, got the number 3"),
        ("100, 200", "expected values such as .*, got the text '100, 200'"),
        (None, "expected values such as .*, got nothing"),
        ({"kind": "ipf"}, "expected values such as .*, got a mapping"),
        ({"range": [0, 1]}, "needs either 'count' .* or 'step'"),
        ({"range": [0, 1], "count": 3, "step": 1}, "needs either 'count' .* or 'step'"),
        ({"range": [0, 1], "count": 0}, "expected a whole number of at least 1, got the number 0"),
        ({"range": [0, 1], "count": 2.5}, "expected a whole number of at least 1, got the number 2.5"),
        ({"range": [0, 1], "count": True}, "expected a whole number of at least 1, got true"),
        ({"range": [0, 1], "cuont": 3}, "unknown key 'cuont' in a range"),
        ({"range": [0, 1], "log_range": [0, 1], "count": 3}, "unknown key 'log_range' in a range"),
        ({"range": [1, 0], "count": 3}, "needs low <= high"),
        ({"range": [1], "count": 3}, r"expected \[low, high\], got a list"),
        ({"range": 5, "count": 3}, r"expected \[low, high\], got the number 5"),
        ({"range": ["1 m", "2 km"], "count": 3}, "both ends need one unit, not 'm' and 'km'"),
        ({"range": [1, "2 m"], "count": 3}, "both ends need one unit, not 'none' and 'm'"),
        ({"range": [0, 1], "step": 0}, "a step must be positive, and in the unit of the range"),
        ({"range": [0, 1], "step": -0.5}, "a step must be positive"),
        ({"range": ["1 m", "2 m"], "step": 1}, r"in the unit of the range \('m'\)"),
        ({"range": ["1 m", "2 m"], "step": "1 cm"}, r"in the unit of the range \('m'\)"),
        ({"range": [0.0, 1e308], "step": 1e-300}, "is too small for a range that wide"),
        ({"range": [-1.7e308, 1.7e308], "step": 1.0}, "is too small for a range that wide"),
        ({"range": [-(10**308), 10**308], "step": 1}, "is too small for a range that wide"),
        ({"log_range": [0, 1], "count": 3}, "needs low <= high, both above 0"),
        ({"log_range": [-1, 1], "count": 3}, "needs low <= high, both above 0"),
        ({"log_range": [1, 10], "step": 1}, "a log_range takes 'count', not 'step'"),
        ({"range": ["a", "b"], "count": 3}, "an end of a range is a finite number, .* not the text 'a'"),
        ({"range": [True, 2], "count": 3}, "an end of a range is a finite number, .* not true"),
        ({"range": [0, math.inf], "count": 3}, "an end of a range is a finite number"),
        ({"range": ["-.inf m", "1 m"], "count": 3}, "an end of a range is a finite number, .* not the text '-.inf m'"),
        ({"range": [1, 10**400], "count": 3}, "an end of a range is a finite number"),
        ({"range": ["1 m", "1e999 m"], "count": 3}, "an end of a range is a finite number"),
    ],
)  # fmt: skip
def test_an_axis_that_cannot_be_says_why(written: Any, message: str) -> None:
    with pytest.raises(InvalidAxis, match=message):
        values(written)


def test_zipped_axes_of_unequal_length_are_refused_with_the_length_of_each() -> None:
    with pytest.raises(InvalidAxis, match=r"must have equal lengths: a\.b has 2, c has 3"):
        axes.zipped(axes_of({"a.b": [1, 2], "c": [1, 2, 3]}))


@pytest.mark.parametrize(
    ("how", "written", "said"),
    [
        (axes.grid, {"a": {"range": [0.0, 1.0], "count": 10**9}}, "1,000,000,000"),
        (axes.grid, {"a": {"range": [0, 10**9 - 1], "step": 1}}, "1,000,000,000"),
        (axes.grid, {"a": {"log_range": [1.0, 2.0], "count": 10**18}}, r"1\.00e\+18"),
        (axes.grid, {f"a{i}": {"range": [0.0, 1.0], "count": 1000} for i in range(3)}, "1,000,000,000"),
        (axes.grid, {f"a{i}": list(range(100)) for i in range(9)}, r"1\.00e\+18"),
        (axes.grid, {"a": list(range(20_001))}, "20,001"),
        (axes.zipped, {"a": {"range": [0.0, 1.0], "count": 10**9}, "b": [1]}, "1,000,000,000"),
    ],
)
def test_what_nobody_can_wait_for_is_refused_before_it_is_listed(how: Any, written: dict[str, Any], said: str) -> None:
    nodes = axes_of(written)
    tracemalloc.start()
    try:
        with counted_calls() as calls, pytest.raises(InvalidAxis, match=rf"makes {said} points; at most 20,000 are"):
            how(nodes)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
    assert calls.number < 2_000


def test_as_many_points_as_are_allowed_are_made() -> None:
    assert len(axes.grid(axes_of({"a": list(range(200)), "b": {"range": [1, 100], "step": 1}}))) == 20_000


@given(st.integers(1, 40), st.integers(0, 40), st.integers(0, 2**32))
def test_a_longer_random_draw_begins_with_the_shorter_one(count: int, more: int, seed: int) -> None:
    over = {"a": {"range": [0.0, 1.0]}, "b": {"range": [1, 9]}, "c": ["x", "y", "z"], "d": {"log_range": [1.0, 1e3]}}
    short, long = drawn(axes.random, count, seed, **over), drawn(axes.random, count + more, seed, **over)
    assert long[: len(short)] == short


def test_a_random_draw_is_uniform_over_each_kind_of_axis() -> None:
    over = {"a": {"range": [2.0, 4.0]}, "b": {"log_range": [1.0, 1e4]}, "c": ["x", "y", "z"], "d": {"range": [1, 5]}}
    found = list(zip(*drawn(axes.random, 5_000, 3, **over), strict=True))
    assert sorted(found[0])[2_500] == pytest.approx(3.0, abs=0.07)
    assert sorted(found[1])[2_500] == pytest.approx(100.0, rel=0.4)
    for column, choices in ((found[2], "xyz"), (found[3], range(1, 6))):
        assert set(column) == set(choices)
        shares = [column.count(choice) / 5_000 for choice in choices]
        assert shares == pytest.approx([1 / len(choices)] * len(choices), abs=0.034), "five standard deviations"


def test_whole_numbers_of_a_log_range_are_drawn_in_proportion_to_their_share_of_the_logarithm() -> None:
    column = [value for value, _ in drawn(axes.random, 5_000, 1, a={"log_range": [1, 4]}, b={"range": [0.0, 1.0]})]
    expected = [math.log((k + 0.5) / (k - 0.5)) / math.log(4.5 / 0.5) for k in range(1, 5)]
    assert [column.count(k) / 5_000 for k in range(1, 5)] == pytest.approx(expected, abs=0.036)


@pytest.mark.parametrize("how", [axes.random, axes.latin_hypercube])
def test_a_draw_depends_on_its_seed_alone(how: Any) -> None:
    over = {"a": {"range": [0.0, 1.0]}, "b": {"range": ["1 m", "2 m"]}}
    assert drawn(how, 9, 5, **over) == drawn(how, 9, 5, **over)
    assert not set(drawn(how, 9, 5, **over)) & set(drawn(how, 9, 6, **over))


@given(st.integers(1, 60), st.integers(0, 2**32))
def test_a_latin_hypercube_has_one_point_in_each_slice_of_each_axis(count: int, seed: int) -> None:
    found = drawn(axes.latin_hypercube, count, seed, a={"range": [2.0, 3.0]}, b={"log_range": [1.0, 1e3]})
    assert sorted(int((a - 2.0) * count) for a, _ in found) == list(range(count))
    assert sorted(int(math.log(b) / math.log(1e3) * count) for _, b in found) == list(range(count))


def test_a_latin_hypercube_takes_each_value_of_a_list_equally_often() -> None:
    found = drawn(axes.latin_hypercube, 30, 1, a=["x", "y", "z"], b={"range": [0.0, 1.0]})
    assert [[a for a, _ in found].count(value) for value in "xyz"] == [10, 10, 10]


def test_points_that_fall_together_are_kept_once() -> None:
    assert sorted(drawn(axes.random, 100, 0, a={"range": [1, 3]})) == [(1,), (2,), (3,)]


@pytest.mark.parametrize("how", [axes.random, axes.latin_hypercube])
@pytest.mark.parametrize(
    ("written", "message"),
    [
        ({"range": [1, 3], "count": 3}, "'count' is not allowed for random points"),
        ({"range": [1, 3], "step": 1}, "'step' is not allowed for random points"),
        ([], "is an empty list"),
        ([1, 1], "is in the list twice"),
        (3, "expected values such as"),
        ({"range": [3, 1]}, "needs low <= high"),
    ],
)
def test_a_draw_over_what_is_no_range_is_refused(how: Any, written: Any, message: str) -> None:
    with pytest.raises(InvalidAxis, match=message):
        drawn(how, 3, a=written)


def test_a_range_of_real_numbers_does_not_round_what_lies_between_whole_ends() -> None:
    made = axes.of_reals(node_of({"range": [0, 1], "count": 3}))
    assert [node.plain() for node in axes.values_of(made)] == [0.0, 0.5, 1.0]
    kept = node_of([0, 1])
    assert axes.of_reals(kept) is kept
